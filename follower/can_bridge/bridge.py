"""Between the other processes and the drives: arming, the gate, and the reaction when it stops the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from common.config import Config
from common.kinematics import wheels_from_twist
from common.messages import ArmSetpoint, Mission
from common.node import Received
from common.timing import NS_PER_S, HeldFor
from follower.can_bridge.arm_gate import ArmDecision, ArmGate, ArmMeasurement, StampedArms
from follower.can_bridge.gate import ArmToken, Decision, Gate, StampedCommand, StopInputs, WheelStatus
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from follower.standstill import BRAKING_NS, Standstill

State = Literal["starting", "disarmed", "enabling", "armed", "stopped", "fault"]
Power = Literal["enable", "stop_arms", "disable", "reset"]
# rules that hold wheels or arms while nothing is wrong
BENIGN_RULES = frozenset({"", "not_armed", "not_enabled", "no_command", "arm_epoch"})
STALLED = "bridge_stalled"
_DISABLE_NS = NS_PER_S // 2
_FIRST_COMMAND_NS = 2 * NS_PER_S


@dataclass(frozen=True, kw_only=True)
class BridgeInputs:
    """The newest messages of the other processes; bridge and gate check their ages."""

    now_ns: int
    command: StampedCommand | None
    mission: Received[Mission] | None
    arms: Received[ArmSetpoint] | None


@dataclass(frozen=True, kw_only=True)
class BridgeOutputs:
    """What to do with the bus in this cycle; ``power`` is the request to the drives, None for no change."""

    setpoint: DriveSetpoint
    power: Power | None
    decision: Decision


class Bridge:
    """Pure: one :meth:`step` per cycle, before the exchange that carries its outputs out.

    A rule of the gate that is not benign stops the motion and disarms until the supervisor begins a new epoch. So
    does a drive that does not answer, a bus with frames that cannot be genuine, and a stall of the bridge itself that
    made the drives' watchdogs stop them (``bridge_stalled``). The watchdogs' latches are released at standstill only,
    by power off; a new epoch waits for that in ``enabling``, as it does for the arms' first set-point.
    """

    def __init__(self, config: Config, boot_id: str) -> None:
        self._config = config
        self._gate = Gate(config.limits, config.base, boot_id)
        self._arm_gate = ArmGate(config.follower_can, boot_id)
        self._stopped_epoch = -1
        self._standstill = Standstill(config.base)
        self._standing = HeldFor(_DISABLE_NS)
        self._uncommanded = HeldFor(_FIRST_COMMAND_NS, strictly=True)
        self._last_intervention: tuple[str, ...] = ()
        self._was_enabled = self._was_stalled = self._led = False
        self._armed_ns = 0
        self._resets: int | None = None
        self.state: State = "starting"
        self.cause = ""
        self._silence = ""
        self.epoch = 0
        self.interventions = 0
        self.intervened: tuple[str, ...] = ()

    def step(self, inputs: BridgeInputs, measured: BusMeasurement) -> BridgeOutputs:
        """Decide from the newest messages and the last exchange.

        Args:
            inputs: the newest messages.
            measured: what the bus reported at the last exchange.

        Returns:
            Set-points and power request of the exchange that follows.
        """
        mission = inputs.mission.message if inputs.mission is not None else None
        if self.state == "starting" and mission is not None and mission.armed:
            # armed under an earlier run of this process: not to be resumed
            self._stopped_epoch, self.epoch = mission.epoch, mission.epoch
            self.state, self.cause = "stopped", "bridge_restarted"
        wanted = mission is not None and mission.armed and mission.epoch != self._stopped_epoch
        self._standstill.step(inputs.now_ns, measured)
        decision = self._gate.step(
            inputs.now_ns,
            inputs.command,
            _arm_token(inputs.mission) if wanted else None,
            wheel_status(measured),
            StopInputs(
                fresh=measured.inputs_fresh,
                estop_clear=measured.estop_clear,
                protective_clear=measured.protective_clear,
            ),
        )
        if mission is not None and wanted:
            self.epoch = mission.epoch
        arms = self._arms(inputs, measured)
        self._follow(inputs, measured, decision, arms, wanted)
        self._count(decision, arms)
        self._led = self._leads(inputs.now_ns, measured, arms.rule)
        power = "reset" if self._asked_to_reset(mission) else self._power(inputs.now_ns, measured, arms.rule)
        return BridgeOutputs(setpoint=self._setpoint(measured, decision, arms), power=power, decision=decision)

    def _asked_to_reset(self, mission: Mission | None) -> bool:
        """Once per request of the operator, and never while anything is or should be enabled."""
        if mission is None or mission.resets == self._resets:
            return False
        known, self._resets = self._resets, mission.resets
        return known is not None and not mission.armed and self.state in ("disarmed", "stopped", "fault")

    def _arms(self, inputs: BridgeInputs, measured: BusMeasurement) -> ArmDecision:
        newest = inputs.arms
        stamped = None
        if newest is not None:
            header = newest.header
            stamped = StampedArms(setpoint=newest.message, stamp_ns=header.stamp_ns, boot_id=header.boot_id)
        angles = ArmMeasurement(
            measured_ns=measured.measured_ns, angles_rad=(*measured.joint_angle_rad, *measured.grip_angle_rad)
        )
        return self._arm_gate.step(inputs.now_ns, stamped, self.epoch, angles)

    def _follow(
        self, inputs: BridgeInputs, measured: BusMeasurement, decision: Decision, arms: ArmDecision, wanted: bool
    ) -> None:
        """Update the arming state from current conditions.

        Args:
            inputs: the newest messages.
            measured: the last exchange.
            decision: of the gate.
            arms: of the arms' gate.
            wanted: the mission is armed, under an epoch that was not stopped.
        """
        stalls, self._was_stalled = bool(measured.stalled) and not self._was_stalled, bool(measured.stalled)
        if measured.faults:
            self.state, self.cause = "fault", measured.faults[0]
            if wanted:
                self._stopped_epoch = self.epoch
        elif passing := STALLED if stalls else self._passing(measured):
            self.state, self.cause = "stopped", passing
            if wanted:
                self._stopped_epoch = self.epoch
        elif not wanted:
            latched = inputs.mission is not None and inputs.mission.message.epoch == self._stopped_epoch
            if latched and self.state in ("stopped", "fault"):
                self.state = "stopped"
            else:
                self.state, self.cause = "disarmed", ""
        elif measured.wheels_enabled and measured.arms_enabled:
            if self.state != "armed":
                self._uncommanded.reset()
            self.state, self.cause = "armed", ""
            reason = self._reason(inputs.now_ns, decision.rule, arms.rule)
            if reason:
                self.state, self.cause = "stopped", reason
                self._stopped_epoch = self.epoch
        elif decision.rule not in BENIGN_RULES:
            self.state, self.cause = "stopped", decision.rule
            self._stopped_epoch = self.epoch
        else:
            self.state, self.cause = "enabling", arms.rule

    def _passing(self, measured: BusMeasurement) -> str:
        """What passes by itself and stops until then; a silence ends only when the stop inputs have been read again.

        Until then they count as STOP, although no button was pressed.
        """
        if measured.passing or measured.inputs_fresh:
            self._silence = measured.passing
        return self._silence

    def _reason(self, now_ns: int, rule: str, arm_rule: str) -> str:
        """Why an armed robot has to be stopped, or ""; one reason is that no command has ever arrived."""
        if self._uncommanded.step(now_ns, rule == "no_command"):
            return rule
        return next((name for name in (rule, arm_rule) if name not in BENIGN_RULES), "")

    def _leads(self, now_ns: int, measured: BusMeasurement, arm_rule: str) -> bool:
        """Whether the arms follow their set-points: armed, and from then on until the base stands."""
        if self.state == "armed":
            self._armed_ns = now_ns
            return not arm_rule
        trouble = arm_rule or measured.faults or measured.passing or measured.stalled or not measured.arms_enabled
        braking = now_ns - self._armed_ns < BRAKING_NS and not self._standstill.holds
        return self._led and self.state in ("stopped", "disarmed") and braking and not trouble

    def _power(self, now_ns: int, measured: BusMeasurement, arm_rule: str) -> Power | None:
        """Arms without a set-point yet are not enabled: without a torque the grippers would open."""
        if self.state in ("enabling", "armed") and not measured.stalled:
            self._standing.reset()
            if not arm_rule:
                self._was_enabled = True
                return "enable"
        elif self._standing.step(now_ns, self._standstill.holds):
            return "disable"
        return "stop_arms" if self._was_enabled and not self._led else None

    def _setpoint(self, measured: BusMeasurement, decision: Decision, arms: ArmDecision) -> DriveSetpoint:
        left, right = wheels_from_twist(self._config.base, decision.v_m_s, decision.w_rad_s)
        setpoint = DriveSetpoint(left_rad_s=left, right_rad_s=right, lift_m=measured.lift_m)
        if arms.rule or not (self._led or self.state in ("enabling", "armed")):
            return setpoint
        return replace(
            setpoint,
            joint_torque_n_m=arms.joint_torque_n_m,
            grip_torque_n_m=arms.grip_torque_n_m,
            lift_m=arms.lift_m,
        )

    def _count(self, decision: Decision, arms: ArmDecision) -> None:
        """Count interventions; the rate rule is none: it spreads every command over its period."""
        rule = decision.rule if decision.rule not in BENIGN_RULES else ""
        names = (rule, decision.dropped, *(name for name in decision.clipped if name != "rate"), *arms.clipped)
        present = tuple(name for name in names if name)
        if present and present != self._last_intervention and self.state in ("armed", "stopped"):
            self.interventions += 1
            self.intervened = present
        self._last_intervention = present


def _arm_token(mission: Received[Mission] | None) -> ArmToken | None:
    if mission is None:
        return None
    message, header = mission.message, mission.header
    return ArmToken(
        armed=message.armed,
        stamp_ns=header.stamp_ns,
        boot_id=header.boot_id,
        epoch=message.epoch,
        phase=message.phase,
        v_max_m_s=message.v_max_m_s,
        w_max_rad_s=message.w_max_rad_s,
    )


def wheel_status(measured: BusMeasurement) -> WheelStatus:
    """What the gate gets of a measurement."""
    speed, angle = measured.wheel_speed_rad_s, measured.wheel_angle_rad
    return WheelStatus(
        measured_ns=measured.measured_ns,
        left_rad_s=speed[0],
        right_rad_s=speed[1],
        left_rad=angle[0],
        right_rad=angle[1],
        # wheels that are still in operation do not drive before the arms hold what they carry
        drives_enabled=measured.wheels_enabled and measured.arms_enabled,
    )
