"""Two robots, one trolley and the floor: the physical truth that drives, I/O modules and light look at.

A model of its own, not the controller's: wheels follow their drives with a lag and, with a trolley in the
grippers, short of what was told; the pose is integrated in 2 ms steps. Not modelled: slip,
drift, tilting, and the arms' motion: they hold one posture.
"""

from __future__ import annotations

import math

from common.config import Config
from common.geometry import Pose2, wrap_angle
from common.timing import NS_PER_S
from sim.can_nodes import FollowerBus, LeaderBus
from sim.contact import Contact
from sim.world_config import WorldConfig

STEP_NS = 2_000_000
# how the handle's force shows up in an arm's three joints, shoulder first, in its holding posture
_JOINT_SHARES = (1.0, 0.6, 0.2)
_GRIP_CLOSED_RAD, _GRIP_OPEN_RAD = 0.0, 1.2
_GRIP_SPEED_RAD_S = 2.0
_GRIP_FREE_TORQUE_N_M = 0.1
_LIFT_SPEED_M_S = 0.05
_LED_TIME_CONSTANT_S = 0.01
_BLOCKED_TRAVEL = 0.5
_TRAVEL_CURRENT_A, _JAM_CURRENT_A = 1.2, 6.0


class Plant:
    """Advances the world to a time; reads set-points from the motors and writes their measurements."""

    def __init__(self, config: Config, world: WorldConfig, follower: FollowerBus, leader: LeaderBus) -> None:
        self._config, self._world, self._follower, self._leader = config, world, follower, leader
        self._wheels = (follower.left_wheel, follower.right_wheel)
        self.pose = world.start_pose
        self.v_m_s = self.w_rad_s = 0.0
        self.pitch_rad = self.roll_rad = 0.0
        self._wheel_speed = [0.0, 0.0]
        self._wheel_angle = [0.0, 0.0]
        self._grip_angle = [_GRIP_OPEN_RAD, _GRIP_OPEN_RAD]
        self._lift_m = config.arms.lift_height_m
        self._lock_travel = 0.0
        self.led_current_a = [0.0] * len(config.leds.positions_m)
        self.contact = Contact(world, self._handle_reach().x_m)
        self.contact.regrip(self._handle_reach().x_m)
        self._grip_angle = [_GRIP_CLOSED_RAD, _GRIP_CLOSED_RAD]
        self.time_ns: int | None = None
        self._move_leader(0.0)

    @property
    def locked(self) -> bool:
        """The actuator stands behind a beam that is in its seat."""
        return self._lock_travel >= 1.0 and self.contact.seated

    def advance(self, now_ns: int) -> None:
        """Simulate up to ``now_ns``, in whole steps."""
        if self.time_ns is None:
            self.time_ns = now_ns
        while self.time_ns + STEP_NS <= now_ns:
            self._step(STEP_NS / NS_PER_S)
            self.time_ns += STEP_NS

    def _step(self, dt_s: float) -> None:
        v_before = self.v_m_s
        self._roll(dt_s)
        reach = self._handle_reach()
        acceleration = (self.v_m_s - v_before) / dt_s
        self._tilt(acceleration, dt_s)
        bound = self._config.docking.lateral_bound_first_m
        self.contact.advance(reach.x_m, acceleration, reach.y_m, bound, dt_s)
        self._move_arms(dt_s)
        self._move_leader(dt_s)

    def _roll(self, dt_s: float) -> None:
        base, world = self._config.base, self._world
        gain = 1.0 + (world.load_gain_per_kg * world.trolley_mass_kg if self.contact.gripped else 0.0)
        follow = 1.0 - math.exp(-dt_s / world.wheel_lag_s)
        for i, motor in enumerate(self._wheels):
            target = motor.velocity_setpoint_rad_s if motor.enabled else 0.0
            self._wheel_speed[i] += follow * (gain * target - self._wheel_speed[i])
            self._wheel_angle[i] += self._wheel_speed[i] * dt_s
        left, right = (speed * base.wheel_radius_m for speed in self._wheel_speed)
        # beyond the traction limit the wheels turn on the spot
        grip = min(1.0, max(0.0, 2.0 - abs(self.contact.handle_force_n) / world.traction_limit_n))
        self.v_m_s, self.w_rad_s = grip * (left + right) / 2, grip * (right - left) / base.track_m
        heading = self.pose.theta_rad + self.w_rad_s * dt_s / 2
        self.pose = Pose2(
            self.pose.x_m + self.v_m_s * math.cos(heading) * dt_s,
            self.pose.y_m + self.v_m_s * math.sin(heading) * dt_s,
            wrap_angle(self.pose.theta_rad + self.w_rad_s * dt_s),
        )
        for i, motor in enumerate(self._wheels):
            motor.set_measured(self._wheel_angle[i], self._wheel_speed[i], 0.0)

    def _tilt(self, acceleration_m_s2: float, dt_s: float) -> None:
        """The chassis sits back when it speeds up, and leans out of a bend."""
        follow = 1.0 - math.exp(-dt_s / self._world.suspension_lag_s)
        self.pitch_rad += follow * (self._world.pitch_per_m_s2 * acceleration_m_s2 - self.pitch_rad)
        self.roll_rad += follow * (self._world.roll_per_m_s2 * self.v_m_s * self.w_rad_s - self.roll_rad)

    def _move_arms(self, dt_s: float) -> None:
        per_arm = self.contact.handle_force_n * self._config.arms.lever_m / 2
        for i, motor in enumerate(self._follower.joints):
            share = _JOINT_SHARES[i % len(_JOINT_SHARES)]
            motor.set_measured(0.0, 0.0, share * per_arm if motor.enabled else 0.0)
        for i, motor in enumerate(self._follower.grippers):
            told = motor.torque_setpoint_n_m if motor.enabled else 0.0
            direction = (told < -_GRIP_FREE_TORQUE_N_M) - (told > _GRIP_FREE_TORQUE_N_M)
            moved = self._grip_angle[i] + direction * _GRIP_SPEED_RAD_S * dt_s
            angle = min(_GRIP_OPEN_RAD, max(_GRIP_CLOSED_RAD, moved))
            speed = (angle - self._grip_angle[i]) / dt_s
            self._grip_angle[i] = angle
            blocked = direction != 0 and speed == 0.0
            motor.set_measured(angle, speed, told if blocked else 0.0)
        closed = all(angle < 0.1 for angle in self._grip_angle)
        if self.contact.gripped and all(angle > 0.3 for angle in self._grip_angle):
            self.contact.gripped = False
        elif closed and not self.contact.gripped and abs(self._handle_reach().x_m - self.contact.beam_x_m) < 0.05:
            self.contact.regrip(self._handle_reach().x_m)
        lift = self._follower.lift
        wanted = lift.position_setpoint if lift.enabled else self._lift_m
        step = _LIFT_SPEED_M_S * dt_s
        self._lift_m += min(step, max(-step, wanted - self._lift_m))
        lift.set_measured(self._lift_m, 0.0, 0.0)

    def _move_leader(self, dt_s: float) -> None:
        leader = self._leader
        share = 1.0 - math.exp(-dt_s / _LED_TIME_CONSTANT_S)
        for i in range(len(self.led_current_a)):
            self.led_current_a[i] += share * (leader.led_setpoint_a(i) - self.led_current_a[i])
            leader.set_led_current(i, self.led_current_a[i])
        moving = leader.actuator
        travel = self._lock_travel + moving * dt_s / self._world.lock_travel_s
        # without a beam in its seat the guide hangs in the bolt's way
        limit = 1.0 if self.contact.seated else _BLOCKED_TRAVEL
        self._lock_travel = min(limit, max(0.0, travel))
        jammed = travel > limit and limit < 1.0
        leader.set_actuator_current(0.0 if not moving else _JAM_CURRENT_A if jammed else _TRAVEL_CURRENT_A)
        leader.set_switches(
            guide_lifted=self.contact.lifted,
            beam_seated=self.contact.seated,
            lock_extended=self._lock_travel >= 1.0,
            lock_retracted=self._lock_travel <= 0.0,
        )

    def _handle_reach(self) -> Pose2:
        """Where the beam is in {L} if the handle carries no force."""
        return self.pose.compose(Pose2(self._world.handle_x_m + self._world.handle_to_beam_m, 0.0, 0.0))
