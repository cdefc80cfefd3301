"""Arms, trolley and guide alone: the base follows a given speed, the arms' own code closes the loop at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from common.config import Config
from common.geometry import Pose2, features_at
from common.kinematics import wheels_from_twist
from common.messages import ArmSetpoint, ArmState, Drives, Mission
from follower.arms.handle import HandleHold
from sim.physics.arm import SimulatedArms
from sim.physics.contact import Contact
from sim.physics.trolley import RubberPad
from sim.world_config import WorldConfig

PLANT_STEP_S = 0.002
PLANT_STEPS_PER_CYCLE = 5
CYCLE_NS = 10_000_000
# per mille of the rated torque, the drives' resolution: 25 N·m at the joint
_TORQUE_STEP_N_M = 0.025
_START_NS = 1_000_000_000


class BenchMotor:
    """A drive without its bus: follows its set-point at once, reports torque in steps."""

    torque_limit_n_m = 25.0

    def __init__(self, effort: Literal["none", "velocity", "torque", "position"] = "torque") -> None:
        self.effort = effort
        self.torque_setpoint_n_m = 0.0
        self.position_setpoint = 0.0
        self.angle_rad = self.torque_n_m = 0.0

    @property
    def enabled(self) -> bool:
        """Whether it has power."""
        return self.effort != "none"

    def set_measured(self, position_rad: float, velocity_rad_s: float, torque_n_m: float) -> None:  # noqa: ARG002
        """Keep what the drive would report."""
        self.angle_rad = position_rad
        self.torque_n_m = _TORQUE_STEP_N_M * round(torque_n_m / _TORQUE_STEP_N_M)


@dataclass(frozen=True)
class Sample:
    """One cycle: time, truth and state of the arms."""

    time_s: float
    beam_x_m: float
    handle_force_n: float
    seated: bool
    state: ArmState


class ContactBench:
    """One run along x_L.

    Args:
        config: the robots.
        world: the plant's parameters, with this run's load and seed.
        beam_x_m: where the trolley's front beam starts, in {L}.
        pads: rubber on the floor.
        lateral_m: of robot and trolley; beyond the bound the beam hits the guide's side, which does not yield.
    """

    def __init__(
        self,
        config: Config,
        world: WorldConfig,
        beam_x_m: float,
        pads: tuple[RubberPad, ...] = (),
        lateral_m: float = 0.0,
    ) -> None:
        self._config, self._world = config, world
        self._robot_x_m = beam_x_m - world.handle_to_beam_m - world.handle_x_m
        self._lateral_m = lateral_m
        handle = Pose2(self._robot_x_m + world.handle_x_m, lateral_m, 0.0)
        self.contact = Contact(world, handle, pads, gripped=True)
        self._joints = tuple(BenchMotor() for _ in range(6))
        self._grippers = (BenchMotor(), BenchMotor())
        self._lift = BenchMotor("position")
        self._lift.position_setpoint = config.arms.lift_height_m
        self.arms = SimulatedArms(config.arms, world, self._joints, self._grippers, self._lift)
        self._hold = HandleHold(config.arms, config.base)
        self._speed_m_s = self._commanded_m_s = 0.0
        self._time_ns = _START_NS
        self._mission = resting_mission(config)
        self._pending: ArmSetpoint | None = None
        self._measured = self._drives()

    @property
    def robot_x_m(self) -> float:
        """The robot along {L}."""
        return self._robot_x_m

    def cycle(self, speed_m_s: float, contact_expected: bool, grip: Literal["open", "closed"] = "closed") -> Sample:
        """Advance 10 ms: the arms get the measurements of one cycle ago, the motors the arms' answer to earlier ones.

        Args:
            speed_m_s: commanded speed of the base.
            contact_expected: as in the mission.
            grip: as in the mission.
        """
        if (contact_expected, grip) != (self._mission.contact_expected, self._mission.grip):
            self._mission = replace(self._mission, contact_expected=contact_expected, grip=grip)
        limit = self._config.limits.gate_acceleration_m_s2 * CYCLE_NS / 1e9
        self._commanded_m_s += min(limit, max(-limit, speed_m_s - self._commanded_m_s))
        self._obey()
        fresh = self._drives()
        state = self._hold.feel(self._measured, self._mission)
        self._pending = self._hold.hold(self._measured, self._mission)
        self._measured = fresh
        for _ in range(PLANT_STEPS_PER_CYCLE):
            self._step()
        self._time_ns += CYCLE_NS
        contact = self.contact
        time_s = (self._time_ns - _START_NS) / 1e9
        return Sample(time_s, contact.beam_x_m, contact.handle_force_n, contact.seated, state)

    def _obey(self) -> None:
        setpoint = self._pending
        if setpoint is None:
            return
        torques = (*setpoint.joint_torque_n_m, *setpoint.grip_torque_n_m)
        for motor, torque in zip((*self._joints, *self._grippers), torques, strict=True):
            motor.torque_setpoint_n_m = torque
        self._lift.position_setpoint = setpoint.lift_m

    def _step(self) -> None:
        dt_s, world, contact = PLANT_STEP_S, self._world, self.contact
        gain = 1.0 + world.load_gain_per_kg * world.trolley_mass_kg
        self._speed_m_s += dt_s / world.wheel_lag_s * (gain * self._commanded_m_s - self._speed_m_s)
        self._robot_x_m += self._speed_m_s * dt_s
        handle = contact.handle
        v_x, v_y, turn = contact.handle_velocity()
        seen = Pose2(handle.x_m - self._robot_x_m, handle.y_m - self._lateral_m, handle.theta_rad)
        f_x, f_y, moment = self.arms.advance(seen, (v_x - self._speed_m_s, v_y, turn), dt_s)
        contact.gripped, contact.handle_force_n = self.arms.holding, f_x
        contact.advance((f_x, f_y), moment, self._config.docking.lateral_bound_first_m, dt_s)

    def _drives(self) -> Drives:
        left, right = self._grippers
        speeds = wheels_from_twist(self._config.base, self._speed_m_s, 0.0)
        distance = self._robot_x_m / self._config.base.wheel_radius_m
        return Drives(
            state="armed",
            cause="",
            epoch=self._mission.epoch,
            measured_ns=self._time_ns,
            wheel_speed_rad_s=speeds,
            wheel_angle_rad=(distance, distance),
            joint_torque_n_m=tuple(motor.torque_n_m for motor in self._joints),
            joint_angle_rad=tuple(motor.angle_rad for motor in self._joints),
            grip_torque_n_m=(left.torque_n_m, right.torque_n_m),
            grip_angle_rad=(left.angle_rad, right.angle_rad),
            lift_m=self._lift.angle_rad,
            stop_inputs_clear=True,
            battery_v=26.0,
            v_set_m_s=self._commanded_m_s,
            w_set_rad_s=0.0,
            command_sequence=0,
            image_to_can_ns=0,
            gate_interventions=0,
        )


def resting_mission(config: Config) -> Mission:
    """An armed mission in the approach that asks for no motion of its own."""
    goal = config.docking.goal(1)
    features = features_at(config.leds.points, goal, config.camera.mount)
    return Mission(
        phase="approach",
        cause="",
        trolley=1,
        epoch=1,
        armed=True,
        motion="hold",
        straight_speed_m_s=0.0,
        v_max_m_s=0.5,
        w_max_rad_s=0.0,
        goal_theta_rad=goal.theta_rad,
        desired_features=tuple((float(a), float(b)) for a, b in features),
        grip="closed",
        contact_expected=False,
        resets=0,
    )
