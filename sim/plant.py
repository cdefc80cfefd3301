"""Two robots, one trolley and the floor: the physical truth that drives, I/O modules and light look at.

A model of its own, not the controller's: wheels follow their drives with a lag and, with a trolley in the
grippers, short of what was told; the pose is integrated in 2 ms steps. Not modelled: slip,
drift, and that the arms' forces turn the base.
"""

from __future__ import annotations

import math

from common.config import Config
from common.geometry import Pose2, wrap_angle
from common.timing import NS_PER_S
from sim.arm import SimulatedArms
from sim.can_nodes import FollowerBus, LeaderBus
from sim.contact import Contact
from sim.world_config import WorldConfig

STEP_NS = 2_000_000
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
        self._lock_travel = 0.0
        self.led_current_a = [0.0] * len(config.leds.positions_m)
        self.contact = Contact(world, self.pose.compose(Pose2(world.handle_x_m, 0.0, 0.0)), gripped=True)
        self.arms = SimulatedArms(config.arms, world, follower.joints, follower.grippers, follower.lift)
        self.time_ns: int | None = None
        self._wheel_target: tuple[float, ...] = (0.0, 0.0)
        self._led_target: tuple[float, ...] = (0.0,) * len(self.led_current_a)
        self._actuator = 0
        self._jammed = False
        self._wheel_share, self._tilt_share, self._led_share = (
            1.0 - math.exp(-STEP_NS / NS_PER_S / constant_s)
            for constant_s in (world.wheel_lag_s, world.suspension_lag_s, _LED_TIME_CONSTANT_S)
        )
        self._report()

    @property
    def locked(self) -> bool:
        """The actuator stands behind a beam that is in its seat."""
        return self._lock_travel >= 1.0 and self.contact.seated

    def advance(self, now_ns: int) -> None:
        """Simulate up to ``now_ns``, in whole steps."""
        if self.time_ns is None:
            self.time_ns = now_ns
        steps = (now_ns - self.time_ns) // STEP_NS
        if steps <= 0:
            return
        # drives are spoken to between two calls only: what they want holds, and only the last they are told counts
        self._wheel_target = tuple(motor.velocity_setpoint_rad_s if motor.enabled else 0.0 for motor in self._wheels)
        self._led_target = tuple(self._leader.led_setpoint_a(i) for i in range(len(self.led_current_a)))
        self._actuator = self._leader.actuator
        self.arms.listen()
        for _ in range(steps):
            self._step(STEP_NS / NS_PER_S)
        self.time_ns += steps * STEP_NS
        self.arms.report()
        self._report()

    def _step(self, dt_s: float) -> None:
        v_before = self.v_m_s
        self._roll(dt_s)
        self._tilt((self.v_m_s - v_before) / dt_s)
        self._move_trolley(dt_s)
        self._move_leader(dt_s)

    def _roll(self, dt_s: float) -> None:
        base, world = self._config.base, self._world
        gain = 1.0 + (world.load_gain_per_kg * world.trolley_mass_kg if self.contact.gripped else 0.0)
        follow = self._wheel_share
        for i, target in enumerate(self._wheel_target):
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

    def _tilt(self, acceleration_m_s2: float) -> None:
        """The chassis sits back when it speeds up, and leans out of a bend."""
        follow = self._tilt_share
        self.pitch_rad += follow * (self._world.pitch_per_m_s2 * acceleration_m_s2 - self.pitch_rad)
        self.roll_rad += follow * (self._world.roll_per_m_s2 * self.v_m_s * self.w_rad_s - self.roll_rad)

    def _move_trolley(self, dt_s: float) -> None:
        """Arms and trolley against each other; the trolley's handle as {F} sees it, the reaction back in {L}."""
        c, s = math.cos(self.pose.theta_rad), math.sin(self.pose.theta_rad)
        handle = self.pose.inverse().compose(self.contact.handle)
        h_x, h_y, turn = self.contact.handle_velocity()
        velocity = (
            c * h_x + s * h_y - self.v_m_s + self.w_rad_s * handle.y_m,
            c * h_y - s * h_x - self.w_rad_s * handle.x_m,
            turn - self.w_rad_s,
        )
        f_x, f_y, moment = self.arms.step(handle, velocity, dt_s)
        self.contact.gripped = self.arms.holding
        self.contact.handle_force_n = f_x
        bound = self._config.docking.lateral_bound_first_m
        self.contact.advance((c * f_x - s * f_y, s * f_x + c * f_y), moment, bound, dt_s)

    def _move_leader(self, dt_s: float) -> None:
        for i, target in enumerate(self._led_target):
            self.led_current_a[i] += self._led_share * (target - self.led_current_a[i])
        travel = self._lock_travel + self._actuator * dt_s / self._world.lock_travel_s
        # without a beam in its seat the guide hangs in the bolt's way
        limit = 1.0 if self.contact.seated else _BLOCKED_TRAVEL
        self._lock_travel = min(limit, max(0.0, travel))
        self._jammed = travel > limit and limit < 1.0

    def _report(self) -> None:
        """What wheels' encoders, current sensors and limit switches read."""
        for motor, angle, speed in zip(self._wheels, self._wheel_angle, self._wheel_speed, strict=True):
            motor.set_measured(angle, speed, 0.0)
        leader = self._leader
        for i, current in enumerate(self.led_current_a):
            leader.set_led_current(i, current)
        current_a = _JAM_CURRENT_A if self._jammed else _TRAVEL_CURRENT_A
        leader.set_actuator_current(current_a if self._actuator else 0.0)
        leader.set_switches(
            guide_lifted=self.contact.lifted,
            beam_seated=self.contact.seated,
            lock_extended=self._lock_travel >= 1.0,
            lock_retracted=self._lock_travel <= 0.0,
        )
