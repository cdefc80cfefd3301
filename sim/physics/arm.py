"""Both simulated SCARA arms, their grippers and the lift: motor commands become motion and force.

Joints move under the motor's torque against the handle, each with inertia, viscous and dry friction and a hard stop
at its limit. A closed gripper holds the handle by a stiff spring and damper; it slips when it is pulled harder than
the fingers can hold. Measured torques are those of the motors' currents: friction is in them, and noise. Not
modelled: inertial coupling between links and from the base's motion, gear play, elastic gears; a free motor has no
brake, its friction holds it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal, Protocol

from common.config import ArmsConfig
from common.geometry import Pose2
from sim.physics.scara import ScaraPlant, Triple
from sim.world_config import WorldConfig

_GRASP_STIFFNESS = (20_000.0, 20_000.0, 200.0)
_GRASP_DAMPING = (250.0, 250.0, 3.0)
_HOLD_BANDWIDTH_RAD_S = 60.0
_GRIP_EMPTY_RAD, _GRIP_HANDLE_RAD, _GRIP_OPEN_RAD = 0.0, 0.15, 1.2
_GRIP_RELEASED_RAD = 0.30
_GRIP_SPEED_RAD_S = 2.0
_GRIP_FREE_TORQUE_N_M = 0.1
_GRIP_REACH_M = 0.05
# clamping torque that the gear's friction keeps while the motor is not powered
_GRIP_GEAR_TORQUE_N_M = 0.6
_LIFT_SPEED_M_S = 0.05


@dataclass(frozen=True)
class _Commanded:
    """Motor commands of all drives; valid until the next :meth:`SimulatedArms.listen`."""

    joints: tuple[tuple[Literal["none", "velocity", "torque", "position"], float, float], ...]
    enabled: tuple[bool, ...]
    grip_n_m: tuple[float | None, ...]
    lift_m: float | None


class Motor(Protocol):
    """A drive as its motor sees it: command and measurement at the output shaft."""

    @property
    def enabled(self) -> bool:
        """Whether the power stage drives the motor."""

    @property
    def effort(self) -> Literal["none", "velocity", "torque", "position"]:
        """Which set-point the motor follows."""

    @property
    def torque_setpoint_n_m(self) -> float:
        """Commanded torque."""

    @property
    def torque_limit_n_m(self) -> float:
        """Largest torque."""

    @property
    def position_setpoint(self) -> float:
        """Commanded or held position: rad, or m for the lift."""

    def set_measured(self, position_rad: float, velocity_rad_s: float, torque_n_m: float) -> None:
        """Report the motion and torque of the shaft."""


@dataclass
class _Gripper:
    """Finger angle, clamping torque, and where on the handle it holds (None: nowhere)."""

    angle_rad: float = _GRIP_OPEN_RAD
    clamp_n_m: float = 0.0
    hold: Triple | None = None
    slippery: bool = False


class SimulatedArms:
    """Left and right arm, grippers, lift. Starts with the handle in the grippers.

    Args:
        config: nominal geometry and holding posture; the real links differ by ``world.link_error``.
        world: inertia, friction, noise.
        joints, grippers, lift: the drives' motors, left before right.
    """

    def __init__(
        self,
        config: ArmsConfig,
        world: WorldConfig,
        joints: tuple[Motor, ...],
        grippers: tuple[Motor, ...],
        lift: Motor,
    ) -> None:
        self._config, self._world = config, world
        self._joints, self._gripper_motors, self._lift = joints, grippers, lift
        self._arms = (ScaraPlant(config, world, 1), ScaraPlant(config, world, -1))
        self.grippers = (_Gripper(), _Gripper())
        self._lift_m = config.lift_height_m
        self._random = Random(world.seed)
        self._places = ((0.0, config.grip_half_width_m, 0.0), (0.0, -config.grip_half_width_m, 0.0))
        for arm, gripper, (_, y_m, _) in zip(self._arms, self.grippers, self._places, strict=True):
            arm.place((world.handle_x_m, y_m, 0.0))
            gripper.hold = (0.0, y_m, 0.0)
            gripper.angle_rad, gripper.clamp_n_m = _GRIP_HANDLE_RAD, config.grip_torque_n_m
        self._commanded = self._read_drives()
        self._measured_torque: tuple[float, ...] = (0.0,) * 6
        self._measured_grip_torque: tuple[float, ...] = (0.0, 0.0)
        self._measure((0.0,) * 6)
        self.report()

    @property
    def holding(self) -> bool:
        """A gripper holds the handle."""
        return any(gripper.hold is not None for gripper in self.grippers)

    @property
    def open(self) -> bool:
        """Both grippers are wide open and hold nothing."""
        return all(gripper.hold is None and gripper.angle_rad >= _GRIP_OPEN_RAD for gripper in self.grippers)

    def make_slippery(self, side: int) -> None:
        """The handle leaves gripper ``side`` (0 left, 1 right) until that is opened: a fault to inject."""
        self.grippers[side].slippery = True

    def advance(self, handle: Pose2, velocity: Triple, dt_s: float) -> Triple:
        """One step from drives to drives: :meth:`listen`, :meth:`step`, :meth:`report`."""
        self.listen()
        reaction = self.step(handle, velocity, dt_s)
        self.report()
        return reaction

    def listen(self) -> None:
        """Read the drives' commands, which change only between exchanges on the bus."""
        self._commanded = self._read_drives()

    def step(self, handle: Pose2, velocity: Triple, dt_s: float) -> Triple:
        """One step under the last commands.

        Args:
            handle: its pose in {F}.
            velocity: of the handle seen from the moving {F}, in its axes: m/s, m/s, rad/s.
            dt_s: the step.

        Returns:
            Force [N] and moment [N·m] on the handle, in the axes of {F}, about its centre.
        """
        torques = self._motor_torques()
        reaction = [0.0, 0.0, 0.0]
        for side, arm in enumerate(self._arms):
            tip, columns = arm.tip()
            gripper = self.grippers[side]
            held = _held(gripper, arm, tip, columns, handle, velocity)
            if held is not None and self._slips(gripper, held, tip[2]):
                gripper.hold, gripper.slippery, held = None, True, None
            force = held or (0.0, 0.0, 0.0)
            by_x, by_y = columns
            one, two, three = torques[3 * side : 3 * side + 3]
            f_x, f_y, moment = force
            motion = (
                one + by_x[0] * f_x + by_y[0] * f_y + moment,
                two + by_x[1] * f_x + by_y[1] * f_y + moment,
                three + by_x[2] * f_x + by_y[2] * f_y + moment,
            )
            arm.move(motion, dt_s)
            lever_x, lever_y = tip[0] - handle.x_m, tip[1] - handle.y_m
            reaction[0] -= f_x
            reaction[1] -= f_y
            reaction[2] -= moment + lever_x * f_y - lever_y * f_x
        self._measured_grip_torque = self._move_grippers(handle, dt_s)
        self._move_lift(dt_s)
        self._measure(torques)
        return reaction[0], reaction[1], reaction[2]

    def _read_drives(self) -> _Commanded:
        joints = []
        for motor in self._joints:
            effort, wanted = motor.effort, 0.0
            if effort == "torque":
                wanted = motor.torque_setpoint_n_m * (1.0 + self._world.joint_torque_error)
            elif effort == "position":
                wanted = motor.position_setpoint
            joints.append((effort, wanted, motor.torque_limit_n_m))
        return _Commanded(
            tuple(joints),
            tuple(motor.enabled for motor in self._joints),
            tuple(motor.torque_setpoint_n_m if motor.effort == "torque" else None for motor in self._gripper_motors),
            self._lift.position_setpoint if self._lift.enabled else None,
        )

    def _motor_torques(self) -> list[float]:
        result = []
        for i, (effort, wanted, limit) in enumerate(self._commanded.joints):
            torque = wanted
            if effort == "position":
                arm, joint = self._arms[i // 3], i % 3
                stiffness = arm.inertia[joint] * _HOLD_BANDWIDTH_RAD_S**2
                damping = 2.0 * arm.inertia[joint] * _HOLD_BANDWIDTH_RAD_S
                torque = stiffness * (wanted - arm.angles[joint]) - damping * arm.speeds[joint]
            result.append(min(limit, max(-limit, torque)))
        return result

    def _slips(self, gripper: _Gripper, force: Triple, heading: float) -> bool:
        """Pushing, the gripper's palm carries the force; pulling, only the friction of the fingers does."""
        pull_n = force[0] * math.cos(heading) + force[1] * math.sin(heading)
        return gripper.slippery or pull_n > self._world.finger_friction_n_per_n_m * gripper.clamp_n_m

    def _move_grippers(self, handle: Pose2, dt_s: float) -> tuple[float, ...]:
        """Close the fingers until they meet the handle or each other; the motors' measured torques."""
        measured = []
        for side, (wanted, gripper) in enumerate(zip(self._commanded.grip_n_m, self.grippers, strict=True)):
            commanded = wanted or 0.0
            if wanted is not None:
                gripper.clamp_n_m = max(_GRIP_GEAR_TORQUE_N_M, commanded)
            near = gripper.hold is not None or self._near(side, handle)
            stop = _GRIP_HANDLE_RAD if near and not gripper.slippery else _GRIP_EMPTY_RAD
            direction = (commanded < -_GRIP_FREE_TORQUE_N_M) - (commanded > _GRIP_FREE_TORQUE_N_M)
            moved = gripper.angle_rad + direction * _GRIP_SPEED_RAD_S * dt_s
            # fingers that are already past the handle do not jump back to it
            low = stop if gripper.angle_rad >= stop else _GRIP_EMPTY_RAD
            angle = min(_GRIP_OPEN_RAD, max(low, moved))
            blocked = direction != 0 and angle == gripper.angle_rad
            if angle > _GRIP_RELEASED_RAD:
                gripper.hold, gripper.slippery = None, False
            elif gripper.hold is None and blocked and angle == _GRIP_HANDLE_RAD:
                gripper.hold = self._place_on(side, handle)
            gripper.angle_rad = angle
            measured.append(commanded if blocked else 0.0)
        return tuple(measured)

    def _near(self, side: int, handle: Pose2) -> bool:
        place = self._places[side]
        x, y, _ = self._place_on(side, handle)
        return math.hypot(x - place[0], y - place[1]) < _GRIP_REACH_M

    def _place_on(self, side: int, handle: Pose2) -> Triple:
        """Where the gripper is, seen from the handle."""
        (x, y, heading), _ = self._arms[side].tip()
        seen = handle.inverse().compose(Pose2(x, y, heading))
        return seen.x_m, seen.y_m, seen.theta_rad

    def _move_lift(self, dt_s: float) -> None:
        wanted = self._lift_m if self._commanded.lift_m is None else self._commanded.lift_m
        step = _LIFT_SPEED_M_S * dt_s
        self._lift_m += min(step, max(-step, wanted - self._lift_m))

    def _measure(self, torques: Sequence[float]) -> None:
        """Set what the current sensors of powered motors read."""
        noise, gauss = self._world.torque_noise_n_m, self._random.gauss
        self._measured_torque = tuple(
            torque + gauss(0.0, noise) if enabled else 0.0
            for torque, enabled in zip(torques, self._commanded.enabled, strict=True)
        )

    def report(self) -> None:
        """Write what encoders and current sensors read to the drives."""
        for i, (motor, torque) in enumerate(zip(self._joints, self._measured_torque, strict=True)):
            arm, joint = self._arms[i // 3], i % 3
            motor.set_measured(arm.angles[joint], arm.speeds[joint], torque)
        for motor, gripper, torque in zip(
            self._gripper_motors, self.grippers, self._measured_grip_torque, strict=True
        ):
            motor.set_measured(gripper.angle_rad, 0.0, torque)
        self._lift.set_measured(self._lift_m, 0.0, 0.0)


def _held(
    gripper: _Gripper, arm: ScaraPlant, tip: Triple, columns: tuple[Triple, Triple], handle: Pose2, velocity: Triple
) -> Triple | None:
    """Force and moment of the handle on a gripper that holds it, in {F}."""
    if gripper.hold is None:
        return None
    c, s = math.cos(handle.theta_rad), math.sin(handle.theta_rad)
    a_x, a_y, a_turn = gripper.hold
    o_x, o_y = c * a_x - s * a_y, s * a_x + c * a_y
    by_x, by_y = columns
    w1, w2, w3 = arm.speeds
    v_x = by_x[0] * w1 + by_x[1] * w2 + by_x[2] * w3
    v_y = by_y[0] * w1 + by_y[1] * w2 + by_y[2] * w3
    (k_x, k_y, k_turn), (d_x, d_y, d_turn) = _GRASP_STIFFNESS, _GRASP_DAMPING
    return (
        k_x * (handle.x_m + o_x - tip[0]) + d_x * (velocity[0] - velocity[2] * o_y - v_x),
        k_y * (handle.y_m + o_y - tip[1]) + d_y * (velocity[1] + velocity[2] * o_x - v_y),
        k_turn * (handle.theta_rad + a_turn - tip[2]) + d_turn * (velocity[2] - w1 - w2 - w3),
    )
