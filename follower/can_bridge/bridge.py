"""What stands between the other processes and the drives: arming, the gate, and what is done when it stops."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from common.config import Config
from common.kinematics import twist_from_wheels, wheels_from_twist
from common.messages import ArmSetpoint, Mission
from common.node import Received
from common.timing import NS_PER_S
from follower.can_bridge.arm_gate import ArmDecision, ArmGate, ArmMeasurement, StampedArms
from follower.can_bridge.gate import ArmToken, Decision, Gate, StampedCommand, StopInputs, WheelStatus
from follower.can_bridge.measurement import DriveSetpoint, Measurement

State = Literal["starting", "disarmed", "enabling", "armed", "stopped", "fault"]
# rules that hold wheels or arms without anything being wrong
BENIGN_RULES = frozenset({"", "not_armed", "not_enabled", "no_command", "arm_epoch"})
STALLED = "bridge_stalled"
_STANDSTILL_M_S = 0.005
_DISABLE_NS = NS_PER_S // 2
_FIRST_COMMAND_NS = 2 * NS_PER_S


@dataclass(frozen=True)
class Heard:
    """What the other processes said last; their ages are judged here and in the gate."""

    now_ns: int
    command: StampedCommand | None
    mission: Received[Mission] | None
    arms: Received[ArmSetpoint] | None


@dataclass(frozen=True)
class Orders:
    """What the bus is to do in this cycle; ``power`` is what is asked of the drives, None for no change."""

    setpoint: DriveSetpoint
    power: Literal["enable", "stop_arms", "disable", "reset"] | None
    decision: Decision


class Bridge:
    """Pure: one :meth:`step` per cycle, before the exchange that carries its orders out.

    A rule of the gate that is not benign stops the motion and disarms until the supervisor begins a new epoch. So
    does a drive that is not heard, a bus with frames that cannot be genuine, and a stall of the bridge itself, which
    the drives' watchdogs noticed (``bridge_stalled``). What these latched is released at standstill only, by power
    off; a new epoch waits for that in ``enabling``, as it does for the arms' first set-point.
    """

    def __init__(self, config: Config, boot_id: str) -> None:
        self._config = config
        self._boot_id = boot_id
        self._gate = Gate(config.limits, config.base, boot_id)
        self._arm_gate = ArmGate(config.follower_can, boot_id)
        self._stopped_epoch = -1
        self._still_since_ns: int | None = None
        self._uncommanded_since_ns = 0
        self._last_intervention: tuple[str, ...] = ()
        self._was_enabled = self._was_stalled = False
        self._resets: int | None = None
        self.state: State = "starting"
        self.cause = ""
        self.epoch = 0
        self.interventions = 0
        self.intervened: tuple[str, ...] = ()

    def step(self, heard: Heard, measured: Measurement) -> Orders:
        """Decide from what was heard and from the last exchange."""
        mission = heard.mission.message if heard.mission is not None else None
        if self.state == "starting" and mission is not None and mission.armed:
            # somebody armed an earlier run of this process: not to be resumed
            self._stopped_epoch, self.epoch = mission.epoch, mission.epoch
            self.state, self.cause = "stopped", "bridge_restarted"
        wanted = mission is not None and mission.armed and mission.epoch != self._stopped_epoch
        decision = self._gate.step(
            heard.now_ns,
            heard.command,
            self._token(heard.mission) if wanted else None,
            WheelStatus(
                measured.measured_ns,
                *measured.wheel_speed_rad_s,
                # wheels that are still in operation do not go before the arms hold what they carry
                measured.wheels_enabled and measured.arms_enabled,
                *measured.wheel_angle_rad,
            ),
            StopInputs(measured.inputs_fresh, measured.estop_clear, measured.protective_clear),
        )
        if mission is not None and wanted:
            self.epoch = mission.epoch
        arms = self._arms(heard, measured)
        self._follow(heard, measured, decision, arms, wanted)
        self._count(decision, arms)
        power = "reset" if self._asked_to_reset(mission) else self._power(heard.now_ns, measured, arms.rule)
        return Orders(self._setpoint(measured, decision, arms), power, decision)

    def _asked_to_reset(self, mission: Mission | None) -> bool:
        """Once per request of a person, and never while anything is enabled or wanted."""
        if mission is None or mission.resets == self._resets:
            return False
        known, self._resets = self._resets, mission.resets
        return known is not None and not mission.armed and self.state in ("disarmed", "stopped", "fault")

    def _token(self, mission: Received[Mission] | None) -> ArmToken | None:
        if mission is None:
            return None
        told, header = mission.message, mission.header
        return ArmToken(
            told.armed, header.stamp_ns, header.boot_id, told.epoch, told.phase, told.v_max_m_s, told.w_max_rad_s
        )

    def _arms(self, heard: Heard, measured: Measurement) -> ArmDecision:
        newest = heard.arms
        stamped = StampedArms(newest.message, newest.header.stamp_ns, newest.header.boot_id) if newest else None
        angles = (*measured.joint_angle_rad, *measured.grip_angle_rad)
        return self._arm_gate.step(heard.now_ns, stamped, self.epoch, ArmMeasurement(measured.measured_ns, angles))

    def _follow(
        self, heard: Heard, measured: Measurement, decision: Decision, arms: ArmDecision, wanted: bool
    ) -> None:
        """The arming state, from what holds now."""
        stalls, self._was_stalled = bool(measured.stalled) and not self._was_stalled, bool(measured.stalled)
        if measured.faults or not measured.bus_ok:
            self.state = "fault"
            self.cause = measured.faults[0] if measured.faults else "bus lost"
            if wanted:
                self._stopped_epoch = self.epoch
        elif stalls or measured.passing:
            self.state = "stopped"
            self.cause = STALLED if stalls else measured.passing
            if wanted:
                self._stopped_epoch = self.epoch
        elif not wanted:
            latched = heard.mission is not None and heard.mission.message.epoch == self._stopped_epoch
            if latched and self.state in ("stopped", "fault"):
                self.state = "stopped"
            else:
                self.state, self.cause = "disarmed", ""
        elif measured.wheels_enabled and measured.arms_enabled:
            if self.state != "armed":
                self._uncommanded_since_ns = heard.now_ns
            self.state, self.cause = "armed", ""
            reason = self._reason(heard.now_ns, decision.rule, arms.rule)
            if reason:
                self.state, self.cause = "stopped", reason
                self._stopped_epoch = self.epoch
        elif decision.rule not in BENIGN_RULES:
            self.state, self.cause = "stopped", decision.rule
            self._stopped_epoch = self.epoch
        else:
            self.state, self.cause = "enabling", arms.rule

    def _reason(self, now_ns: int, rule: str, arm_rule: str) -> str:
        """Why an armed robot has to be stopped, or "": also when nobody who commands reaches this process."""
        if rule != "no_command":
            self._uncommanded_since_ns = now_ns
        elif now_ns - self._uncommanded_since_ns > _FIRST_COMMAND_NS:
            return rule
        return next((name for name in (rule, arm_rule) if name not in BENIGN_RULES), "")

    def _power(
        self, now_ns: int, measured: Measurement, arm_rule: str
    ) -> Literal["enable", "stop_arms", "disable"] | None:
        """Arms that nobody leads yet are not enabled: without a torque they would let go of what they hold."""
        if self.state in ("enabling", "armed") and not measured.stalled:
            self._still_since_ns = None
            if not arm_rule:
                self._was_enabled = True
                return "enable"
        else:
            v, _ = twist_from_wheels(self._config.base, measured.wheel_speed_rad_s)
            if abs(v) > _STANDSTILL_M_S:
                self._still_since_ns = None
            elif self._still_since_ns is None:
                self._still_since_ns = now_ns
            if self._still_since_ns is not None and now_ns - self._still_since_ns >= _DISABLE_NS:
                return "disable"
        return "stop_arms" if self._was_enabled else None

    def _setpoint(self, measured: Measurement, decision: Decision, arms: ArmDecision) -> DriveSetpoint:
        left, right = wheels_from_twist(self._config.base, decision.v_m_s, decision.w_rad_s)
        setpoint = DriveSetpoint(left, right, lift_m=measured.lift_m)
        if self.state not in ("enabling", "armed") or arms.rule:
            return setpoint
        return replace(
            setpoint,
            joint_torque_n_m=arms.joint_torque_n_m,
            grip_torque_n_m=arms.grip_torque_n_m,
            lift_m=arms.lift_m,
        )

    def _count(self, decision: Decision, arms: ArmDecision) -> None:
        """Interventions; the rate rule spreads every command over its period and is none."""
        rule = decision.rule if decision.rule not in BENIGN_RULES else ""
        names = (rule, decision.dropped, *(name for name in decision.clipped if name != "rate"), *arms.clipped)
        present = tuple(name for name in names if name)
        if present and present != self._last_intervention and self.state in ("armed", "stopped"):
            self.interventions += 1
            self.intervened = present
        self._last_intervention = present
