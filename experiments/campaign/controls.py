"""Positive controls: a check that is taken out must turn the campaign red in the rows that ought to notice.

Every rule of the gates has one, and every guard of the supervisor; ``STAND_IN`` names those that no row catches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from experiments.campaign.patches import (
    GATE,
    SEQUENCE,
    Patch,
    becomes,
    forget,
    found,
    refusal_sees,
    returns,
    stop_rule_sees,
    supervisor_sees,
    takes,
    unlatched,
    without,
)

_ARM_GATE = "follower.can_bridge.arm_gate"
_BRIDGE, _INBOUND = "follower.can_bridge.bridge", "follower.can_bridge.inbound"
_ATTEMPT = "follower.supervisor.attempt"
_FOREVER = 10**9


@dataclass(frozen=True, kw_only=True)
class Control:
    """One check: how it is removed, and which rows ought to notice, in which phases.

    ``patches`` name a module and an attribute in it, and make the replacement from what is there.
    """

    layer: str
    patches: tuple[Patch, ...]
    rows: tuple[str, ...]
    phases: tuple[str, ...] = ("approach",)

    def remove(self) -> None:
        """Take the check out, in this process.

        Raises:
            AttributeError: there is no such check in the code.
        """
        for target, make in self.patches:
            holder, name = found(target)
            setattr(holder, name, make(vars(holder)[name]))


_CLEAR = {"fresh": True, "estop_clear": True, "protective_clear": True}
_LATE_ROWS = ("S01", "S02", "S16", "S27")
CONTROLS: dict[str, Control] = {
    # the gate's rules
    "gate: command_age": Control(
        layer="gate", patches=(becomes(f"{GATE}:COMMAND_MAX_AGE_MS", _FOREVER),), rows=_LATE_ROWS),
    "gate: valid_until": Control(
        layer="gate", patches=(without(f"{GATE}:Gate._stop_rule", "valid_until"),), rows=_LATE_ROWS),
    "gate: command_age and valid_until": Control(
        layer="gate",
        patches=(becomes(f"{GATE}:COMMAND_MAX_AGE_MS", _FOREVER), without(f"{GATE}:Gate._stop_rule", "valid_until")),
        rows=_LATE_ROWS,
    ),
    "gate: token_age": Control(layer="gate", patches=(becomes(f"{GATE}:TOKEN_MAX_AGE_MS", _FOREVER),), rows=("S05",)),
    "gate: status_age": Control(
        layer="gate", patches=(becomes(f"{GATE}:STATUS_MAX_AGE_MS", _FOREVER),), rows=("S21", "S23", "S19")),
    "gate: not_enabled": Control(layer="gate", patches=stop_rule_sees(drives_enabled=True), rows=("S06", "S20",
    "S21", "S47")),
    "gate: stop_input": Control(layer="gate", patches=stop_rule_sees(**_CLEAR), rows=("S33", "S19")),
    "gate: not_finite": Control(
        layer="gate", patches=(without(f"{GATE}:Gate._refusal", "not_finite"),), rows=("S14",)),
    "gate: checksum": Control(
        layer="gate", patches=((f"{GATE}:command_checksum", lambda _old: lambda c: c.checksum),), rows=("S43",)),
    "gate: boot": Control(
        layer="gate", patches=refusal_sees(lambda g, n, t: (g, replace(n, boot_id=g._boot_id), t)), rows=("S43",)),
    "gate: epoch": Control(
        layer="gate", patches=refusal_sees(lambda g, n, t: (g, n, t and replace(t, epoch=n.command.epoch))),
        rows=("S43", "S41")),
    "gate: second_writer": Control(
        layer="gate", patches=refusal_sees(lambda g, n, t: forget(g, n, t, _writer=None)), rows=("S42", "S41")),
    "gate: sequence": Control(
        layer="gate", patches=refusal_sees(lambda g, n, t: forget(g, n, t, _sequence=-1)),
        rows=("S26", "S27", "S43")),
    "gate: caps": Control(
        layer="gate", patches=(returns(f"{GATE}:Gate._cap_scale", 1.0),),
        rows=("S42", "S13", "S10"), phases=("approach", "last_metre")),
    "gate: rate": Control(
        layer="gate", patches=(returns(f"{GATE}:Gate._step_s", 10.0),), rows=("S13", "S26", "S11")),
    "gate: window": Control(
        layer="gate", patches=(returns(f"{GATE}:Gate._window_share", 1.0),), rows=("S13", "S26", "S11")),
    "gate: token_caps": Control(
        layer="gate", patches=(without(f"{GATE}:Gate._stop_rule", "token_caps"),), rows=("S14",)),
    "gate: measured_angle": Control(
        layer="gate", patches=(returns(f"{GATE}:Gate._contradicted", ""),), rows=("S22",)),
    "gate: measured_jump": Control(layer="gate", patches=(returns(f"{GATE}:Gate._jumped", ""),), rows=("S22",)),
    "gate: measured_gap": Control(layer="gate", patches=(returns(f"{GATE}:_beyond", False),), rows=("S22", "S40")),
    "gate: measured_stuck": Control(
        layer="gate", patches=(returns("follower.can_bridge.wheel_tracking:WheelTrackingMonitor.step", False),),
        rows=("S22", "S40"),
        phases=("last_metre", "insert", "retract"),
    ),
    # the arms' gate and the bridge
    "arm gate: age": Control(
        layer="arm gate", patches=(becomes(f"{_ARM_GATE}:SETPOINT_MAX_AGE_MS", _FOREVER),), rows=("S49",)),
    "arm gate: jump": Control(
        layer="arm gate", patches=(becomes(f"{_ARM_GATE}:MAX_JOINT_STEP_RAD", _FOREVER),), rows=("S22",)),
    "arm gate: not finite": Control(
        layer="arm gate", patches=(without(f"{_ARM_GATE}:ArmGate._refusal", "arm_not_finite"),), rows=("S14",)),
    "arm gate: not measured": Control(
        layer="arm gate", patches=(without(f"{_ARM_GATE}:ArmGate._refusal", "arm_not_measured"),), rows=("S22",)),
    "arm gate: epoch": Control(
        layer="arm gate", patches=(without(f"{_ARM_GATE}:ArmGate._refusal", "arm_epoch"),), rows=("S49", "S41")),
    "arm gate: speed": Control(
        layer="arm gate", patches=(("follower.can_bridge.arm_gate:ArmGate._slow", lambda _old: lambda _gate, t: t),),
        rows=("S38", "S39")),
    "bridge: arms led while braking": Control(
        layer="bridge", patches=(returns(f"{_BRIDGE}:Bridge._leads", False),), rows=("S39", "S05")),
    "bridge: drive faults": Control(
        layer="bridge", patches=(returns(f"{_INBOUND}:_axis_faults", []),), rows=("S20",)),
    "bridge: silent drives": Control(
        layer="bridge", patches=(returns(f"{_INBOUND}:Inbound.silent", []),), rows=("S21",)),
    "bridge: bad frames": Control(
        layer="bridge", patches=(returns(f"{_INBOUND}:Inbound.bad_frames", ""),), rows=("S23",)),
    "bridge: its own stall": Control(
        layer="bridge", patches=(returns("follower.can_bridge.drive_bus:DriveBus._check_stall", False),),
        rows=("S06",)),
    "bridge: latched epoch": Control(
        layer="bridge",
        patches=((f"{_BRIDGE}:Bridge.step", lambda old: lambda self, *args: unlatched(old, self, *args)),),
        rows=("S01", "S41", "S42")),
    # layers that stand in for one another: alone nothing is missed, together it must be
    "gate and supervisor: stop inputs": Control(
        layer="gate and supervisor",
        patches=(*stop_rule_sees(**_CLEAR), returns(f"{SEQUENCE}:DockingSequence._watch", None)),
        rows=("S33",)),
    "gate and bridge: silent drives": Control(
        layer="gate and bridge",
        patches=(becomes(f"{GATE}:STATUS_MAX_AGE_MS", _FOREVER), returns(f"{_INBOUND}:Inbound.silent", [])),
        rows=("S21",)),
    # the supervisor's guards
    "supervisor: restarted": Control(
        layer="supervisor", patches=supervisor_sees(lambda s: replace(s, restarted="")), rows=("S41",)),
    "supervisor: all that ends a docking": Control(
        layer="supervisor", patches=(returns(f"{SEQUENCE}:DockingSequence._watch", None),),
        rows=("S33", "S20", "S38", "S41")),
    "supervisor: arms' cause": Control(
        layer="supervisor",
        patches=supervisor_sees(lambda s: replace(s, arms=s.arms and replace(s.arms, cause="ok"))),
        rows=("S38", "S39")),
    "supervisor: contact too early": Control(
        layer="supervisor",
        patches=supervisor_sees(lambda s: replace(s, arms=s.arms and replace(s.arms, connected=False))),
        rows=("S39",)),
    "supervisor: LEDs in sight": Control(
        layer="supervisor", patches=(returns(f"{_ATTEMPT}:Attempt.blind", ""),), rows=("S03", "S04", "S11", "S35")),
    "supervisor: Follower's health": Control(
        layer="supervisor", patches=(returns(f"{_ATTEMPT}:Attempt.unwell", ""),), rows=("S46", "S03")),
    "supervisor: lock agrees with odometry": Control(
        layer="supervisor", patches=(returns("follower.model.dead_reckoning:WheelReckoning.agrees", True),),
        rows=("S13", "S12")),
    "supervisor: wheel slip": Control(
        layer="supervisor", patches=(returns("follower.supervisor.phases.approach:WheelSlip.step", False),),
        rows=("S40",)),
    "supervisor: two malformed messages": Control(
        layer="supervisor", patches=(returns("follower.supervisor.node:_malformed", ""),), rows=("S14",)),
    "supervisor: late loops": Control(
        layer="supervisor", patches=(returns("follower.supervisor.late_watch:LateWatch.step", ""),), rows=("S29",)),
    "supervisor: battery": Control(
        layer="supervisor", patches=(returns(f"{_ATTEMPT}:undervoltage", ""),), rows=("S46",)),
    "supervisor: doubted image": Control(
        layer="supervisor", patches=(returns("follower.supervisor.image_trust:ImageTrust.step", None),),
        rows=("S08",), phases=("last_metre", "push")),
    "supervisor: drive fault": Control(
        layer="supervisor", patches=supervisor_sees(
            lambda s: replace(s, drives=s.drives and replace(
                s.drives, state="stopped" if s.drives.state == "fault" else s.drives.state))),
        rows=("S20",)),
    "supervisor: drives silent": Control(
        layer="supervisor", patches=(becomes(f"{SEQUENCE}:_SILENT_NS", _FOREVER**2),), rows=("S06", "S47")),
    "supervisor: passing stops": Control(
        layer="supervisor", patches=(returns(f"{SEQUENCE}:DockingSequence._passing", None),),
        rows=("S01", "S14", "S49")),
    "supervisor: implausible lock": Control(
        layer="supervisor", patches=supervisor_sees(lambda s: replace(s, leader=None)), rows=("S37",),
        phases=("insert", "push")),
    "supervisor: calibration": Control(
        layer="supervisor", patches=(returns("follower.supervisor.fitness:CalibrationWatch.unfit", ""),),
        rows=("S32",), phases=("idle",)),
    "supervisor: certificate": Control(
        layer="supervisor", patches=(returns("follower.supervisor.node:certificate_unfit", ""),),
        rows=("S45",), phases=("idle",)),
    "supervisor: reduced speed": Control(
        layer="supervisor",
            patches=(returns("follower.supervisor.phases.approach:ApproachPhase._missing_leds", ()),),
        rows=("S10",)),
    "supervisor: Leader's lock": Control(
        layer="supervisor", patches=(returns(f"{_ATTEMPT}:Attempt.leader_unready", ""),),
        rows=("S37",), phases=("idle",)),
    "supervisor: undervoltage at start": Control(
        layer="supervisor", patches=(
            returns("follower.supervisor.node:undervoltage", ""), returns(f"{_ATTEMPT}:undervoltage", "")),
        rows=("S46",), phases=("idle",)),
    "supervisor: reports on disk": Control(
        layer="supervisor", patches=(returns("follower.supervisor.journal:Journal.unfit", ""),),
        rows=("S28",), phases=("idle",)),
    "supervisor: latch": Control(
        layer="supervisor", patches=(returns(f"{SEQUENCE}:needs_reset", False),), rows=("S33", "S20", "S39")),
    "supervisor: last metre's cap": Control(
        layer="supervisor", patches=(becomes("follower.supervisor.phases.approach:LAST_METRE_M", -10.0),),
        rows=("S26",), phases=("last_metre",)),
    # health checks of estimator, arms, controller, Leader
    "estimator: frozen camera": Control(
        layer="health", patches=(
            returns("follower.estimator.image_health:ImageHealth.frozen", False),
            returns("follower.estimator.image_health:ImageFollows.doubted", False)),
        rows=("S08",)),
    "estimator: image follows the wheels": Control(
        layer="health", patches=(returns("follower.estimator.image_health:ImageFollows.doubted", False),),
        rows=("S08",)),
    "estimator: exposure": Control(
        layer="health", patches=(
            becomes("follower.estimator.image_health:_WHITE_PART", 2.0),
            becomes("follower.estimator.image_health:_DARKEST", -1.0)),
        rows=("S09",)),
    "estimator: frame's age": Control(
        layer="health", patches=(("follower.estimator.node:FRAME", lambda old: replace(old, max_age_ms=1e9)),),
        rows=("S07",)),
    "arms: collision": Control(
        layer="health", patches=(returns("follower.arms.collision_detection:CollisionDetector.step", False),),
        rows=("S39",)),
    "arms: slip": Control(
        layer="health", patches=(returns("follower.arms.slip_detection:SlipDetector.step", False),), rows=("S38",)),
    "controller: solver's status": Control(
        layer="health",
        patches=(("follower.controller.interface:Plan.usable", lambda _old: property(lambda _plan: True)),),
        rows=("S15",)),
    "controller: states that come late": Control(
        layer="health", patches=(becomes("follower.controller.node:_LATE_NS", _FOREVER),), rows=("S29",)),
    "controller: solve late": Control(
        layer="health",
        patches=(takes("follower.controller.node:ControllerNode.step", lambda node, *args: (_patient(node), *args)),),
        rows=("S16",)),
    "controller: replayed plans": Control(
        layer="health", patches=(becomes("follower.controller.replay:MAX_REPLAYED_PLANS", 40),),
        rows=("S15", "S03", "S04")),
    "Leader: jammed and overdue": Control(
        layer="health", patches=(
            returns("leader.lock:BoltLock._jammed", False), returns("leader.lock:BoltLock._overdue", False)),
        rows=("S36",), phases=("push",)),
    "Leader: doubtful switches": Control(
        layer="health", patches=(returns("leader.lock:BoltLock._check_switches", None),), rows=("S37",),
        phases=("idle", "push")),
}  # fmt: skip


# without these nothing turns red: what stands in for them, or where they are tested
STAND_IN = {
    "gate: command_age": "valid_until stands in: without both it is missed",
    "gate: valid_until": "command_age stands in: without both it is missed",
    "gate: status_age": "the bridge's silent drives stand in: without both it is missed",
    "gate: stop_input": "the supervisor stands in: without both it is missed",
    "gate: not_enabled": "a drive that is not in operation follows no set-point",
    "gate: not_finite": "no such message can be decoded; tests/unit/follower/can_bridge",
    "gate: boot": "an inbox takes no message of another boot; tests/unit/follower/can_bridge",
    "gate: caps": "not tested here: the controller keeps them by itself; tests/unit/follower/can_bridge",
    "gate: rate": "not tested here: the controller keeps it by itself; tests/unit/follower/can_bridge",
    "gate: window": "not tested here: the controller keeps it by itself; tests/unit/follower/can_bridge",
    "bridge: its own stall": "the drives' watchdogs stop first; it decides on re-arming, which is not judged here",
    "bridge: latched epoch": "the supervisor goes on to another epoch before the next command",
    "supervisor: contact too early": "the collision's limit notices before",
    "controller: solver's status": "a failed plan commands zero",
    "controller: solve late": "the gate's command_age stands in: what comes late is too old, or stamped ahead",
    "arm gate: epoch": "the arms take up a new epoch before the drives are enabled; tests/unit/follower/can_bridge",
    "controller: states that come late": "the command after a gap of 75 ms stands in, with loops up to 30 ms late",
    "bridge: arms led while braking": "rare: the grip must be at its limit; tests/unit/follower/can_bridge",
    "supervisor: drives silent": "the drives' watchdogs stop first; it names the end of the docking",
    "supervisor: passing stops": "the bridge has stopped and keeps its epoch stopped; it decides on what follows",
    "gate: token_caps": "no such mission can be decoded; tests/unit/follower/can_bridge",
    "arm gate: not finite": "no such message can be decoded; tests/unit/follower/can_bridge",
    "arm gate: not measured": "no drive reports such an angle; tests/unit/follower/can_bridge",
    "arm gate: speed": "the arms keep it by themselves; tests/unit/follower/can_bridge",
}


def _patient(node: Any) -> Any:
    """A controller that publishes a command, however long the solve took."""
    node._deadline_ns = _FOREVER**2
    return node
