"""Both robots, trolleys and the floor: the physical truth behind drives, I/O modules and light.

This model shares nothing with the controller's: wheels follow their drives with a lag and, with a trolley in the
grippers, more slowly than commanded; the pose is integrated in 2 ms steps; an uneven floor tilts the camera as the
robot drives. Wheels slip beyond the traction limit and where ``floor_grip`` says so. Not modelled: drift, and the
turning of the base by the forces of the arms.
"""

from __future__ import annotations

import math

from common.config import Config
from common.geometry import Pose2, wrap_angle
from common.timing import NS_PER_S
from sim.can.nodes import FollowerBus, LeaderBus
from sim.optics.scenes import named_scene
from sim.physics.arm import SimulatedArms
from sim.physics.contact import Contact
from sim.physics.leader_plant import LeaderPlant
from sim.world_config import WorldConfig

STEP_NS = 2_000_000
_TRACK_SHARE = 0.25
_GRIP_LAG_S = 0.4  # no floor stops or pulls the robot faster than 0.75 m/s² at 0.3 m/s
# the next trolley comes once the Follower has stood for this long
_STOOD_S = 0.3
_STANDING_M_S = 0.005
_STAGING_SLACK_M = 0.15


class Plant:
    """Advances the world to a time; reads set-points from the motors and writes their measurements."""

    def __init__(self, config: Config, world: WorldConfig, follower: FollowerBus, leader: LeaderBus) -> None:
        self._config, self._world, self._follower, self._leader = config, world, follower, leader
        self._wheels = (follower.left_wheel, follower.right_wheel)
        self.pose = world.start_pose  # {F} in {L}
        self.v_m_s = self.w_rad_s = 0.0
        self.pitch_rad = self.roll_rad = 0.0
        self._wheel_speed = [0.0, 0.0]
        self._wheel_angle = [0.0, 0.0]
        handle = self.pose.compose(Pose2(world.handle_x_m, 0.0, 0.0))
        self.contact = Contact(world, handle, gripped=True, pitch_m=config.docking.trolley_pitch_m)
        step_s = STEP_NS / NS_PER_S
        self.leader = LeaderPlant(world, leader, len(config.leds.positions_m), self.contact.queue.guide, step_s)
        # robot speed over wheel surface speed, once its inertia is used up: less than 1 on a wet floor
        self.floor_grip = self._grip = 1.0
        # obstacles that block the light: x, y in {L}, radius [m]
        self.occluders: tuple[tuple[float, float, float], ...] = ()
        self._scene = named_scene(world.scene, world.seed)
        self._driven_m = 0.0
        self._still_s = 0.0
        self._suspension = [0.0, 0.0]
        self.arms = SimulatedArms(config.arms, world, follower.joints, follower.grippers, follower.lift)
        self.time_ns: int | None = None
        self._wheel_target: tuple[float, ...] = (0.0, 0.0)
        self._wheel_share, self._tilt_share, self._grip_share = (
            1.0 - math.exp(-step_s / constant_s)
            for constant_s in (world.wheel_lag_s, world.suspension_lag_s, _GRIP_LAG_S)
        )

    def advance(self, now_ns: int) -> None:
        """Simulate up to ``now_ns``, in whole steps."""
        if self.time_ns is None:
            self.time_ns = now_ns
        steps = (now_ns - self.time_ns) // STEP_NS
        if steps <= 0:
            return
        # the drives get commands between two calls only: the newest ones hold for all steps
        self._wheel_target = tuple(motor.velocity_setpoint_rad_s if motor.enabled else 0.0 for motor in self._wheels)
        self.leader.listen()
        self.arms.listen()
        for _ in range(steps):
            self._step(STEP_NS / NS_PER_S)
        self.time_ns += steps * STEP_NS
        self.arms.report()
        self.leader.report()
        for motor, angle, speed in zip(self._wheels, self._wheel_angle, self._wheel_speed, strict=True):
            motor.set_measured(angle, speed, 0.0)

    def _step(self, dt_s: float) -> None:
        v_before = self.v_m_s
        self._roll(dt_s)
        self._tilt((self.v_m_s - v_before) / dt_s, dt_s)
        self._move_trolley(dt_s)
        self.leader.step(dt_s)
        self._fetch(dt_s)

    def _roll(self, dt_s: float) -> None:
        base, world = self._config.base, self._world
        gain = 1.0 + (world.load_gain_per_kg * self.contact.trolley.mass_kg if self.contact.gripped else 0.0)
        follow = self._wheel_share
        for i, target in enumerate(self._wheel_target):
            self._wheel_speed[i] += follow * (gain * target - self._wheel_speed[i])
            self._wheel_angle[i] += self._wheel_speed[i] * dt_s
        left, right = (speed * base.wheel_radius_m for speed in self._wheel_speed)
        # beyond the traction limit the wheels turn on the spot
        self._grip += self._grip_share * (self.floor_grip - self._grip)
        grip = min(self._grip, max(0.0, 2.0 - abs(self.contact.handle_force_n) / world.traction_limit_n))
        self.v_m_s, self.w_rad_s = grip * (left + right) / 2, grip * (right - left) / base.track_m
        heading = self.pose.theta_rad + self.w_rad_s * dt_s / 2
        self.pose = Pose2(
            self.pose.x_m + self.v_m_s * math.cos(heading) * dt_s,
            self.pose.y_m + self.v_m_s * math.sin(heading) * dt_s,
            wrap_angle(self.pose.theta_rad + self.w_rad_s * dt_s),
        )

    def _tilt(self, acceleration_m_s2: float, dt_s: float) -> None:
        """The chassis sits back when it speeds up, leans out of a bend, and follows the floor."""
        world, suspension = self._world, self._suspension
        suspension[0] += self._tilt_share * (world.pitch_per_m_s2 * acceleration_m_s2 - suspension[0])
        suspension[1] += self._tilt_share * (world.roll_per_m_s2 * self.v_m_s * self.w_rad_s - suspension[1])
        self._driven_m += (abs(self.v_m_s) + _TRACK_SHARE * abs(self.w_rad_s)) * dt_s
        floor_pitch, floor_roll = self._scene.floor_tilt(self._driven_m)
        self.pitch_rad, self.roll_rad = suspension[0] + floor_pitch, suspension[1] + floor_roll

    def _move_trolley(self, dt_s: float) -> None:
        """Arms and trolley against each other: motion of the handle into {F}, the reaction back into {L}."""
        c, s = math.cos(self.pose.theta_rad), math.sin(self.pose.theta_rad)
        handle_in_follower = self.pose.inverse().compose(self.contact.handle)
        h_x, h_y, turn = self.contact.handle_velocity()
        velocity = (
            c * h_x + s * h_y - self.v_m_s + self.w_rad_s * handle_in_follower.y_m,
            c * h_y - s * h_x - self.w_rad_s * handle_in_follower.x_m,
            turn - self.w_rad_s,
        )
        f_x, f_y, moment = self.arms.step(handle_in_follower, velocity, dt_s)
        self.contact.gripped = self.arms.holding
        self.contact.handle_force_n = f_x
        docking = self._config.docking
        bound = docking.lateral_bound_next_m if len(self.contact.queue) else docking.lateral_bound_first_m
        self.contact.advance((c * f_x - s * f_y, s * f_x + c * f_y), moment, bound, dt_s)

    def _fetch(self, dt_s: float) -> None:
        """Place the next trolley once the Follower stands ready for it and the one before is locked."""
        still = abs(self.v_m_s) < _STANDING_M_S and abs(self.w_rad_s) < _STANDING_M_S and self.arms.open
        self._still_s = self._still_s + dt_s if still else 0.0
        if self._still_s < _STOOD_S or not (self.contact.home and self.leader.locked):
            return
        docking = self._config.docking
        staging = docking.goal(len(self.contact.queue) + 2).x_m + docking.staging_distance_m
        if -self.pose.x_m >= staging - _STAGING_SLACK_M:
            self.contact.place_next(self.pose, self._config.arms.handle_x_m)
