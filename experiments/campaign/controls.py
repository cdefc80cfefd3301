"""Positive controls: a check that is taken out must turn the campaign red in the rows that ought to notice.

Each names what it replaces as text, so that one which does not fit the code any more is found by a test.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

Patch = tuple[str, Callable[[Any], Any]]
_GATE, _ARM_GATE = "follower.can_bridge.gate", "follower.can_bridge.arm_gate"
_BRIDGE, _INBOUND = "follower.can_bridge.bridge", "follower.can_bridge.inbound"
_SEQUENCE, _ATTEMPT = "follower.supervisor.sequence", "follower.supervisor.attempt"
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


def found(target: str) -> tuple[Any, str]:
    """The module or class that a target ``module:Class.attribute`` lies in, and the attribute's name.

    Raises:
        AttributeError: it does not exist.
    """
    module, _, path = target.partition(":")
    holder: Any = import_module(module)
    *classes, name = path.split(".")
    for each in classes:
        holder = getattr(holder, each)
    if name not in vars(holder):
        raise AttributeError(f"{target}: there is no {name}")
    return holder, name


def _set(target: str, value: Any) -> Patch:
    return target, lambda _old: value


def _returns(target: str, value: Any) -> Patch:
    return target, lambda _old: lambda *_args, **_named: value


def _takes(target: str, change: Callable[..., tuple[Any, ...]]) -> Patch:
    """The function gets what ``change`` makes of its arguments."""

    def make(old: Any) -> Any:
        return lambda *args: old(*change(*args))

    return target, make


def _without(target: str, rule: str) -> Patch:
    """The function never names this rule."""
    return target, lambda old: lambda *args: "" if (named := old(*args)) == rule else named


def _refusal(change: Callable[[Any, Any, Any], tuple[Any, ...]]) -> tuple[Patch, ...]:
    """A rule of what the gate takes, blinded: gate, command and token as the rule is to see them."""
    return (_takes(f"{_GATE}:Gate._refusal", change),)


def _sees(change: Callable[[Any], Any]) -> tuple[Patch, ...]:
    """A guard of the supervisor, blinded: it sees what ``change`` makes of the observation."""
    return (_takes(f"{_SEQUENCE}:DockingSequence.step", lambda self, seen: (self, change(seen))),)


def _forget(gate: Any, newest: Any, token: Any, **fields: Any) -> tuple[Any, ...]:
    for name, value in fields.items():
        setattr(gate, name, value)
    return gate, newest, token


def _stop_rule(**fields: Any) -> tuple[Patch, ...]:
    """Rules of the gate that look at wheels or stop inputs see these values instead."""

    def change(gate: Any, now_ns: int, token: Any, status: Any, inputs: Any) -> tuple[Any, ...]:
        stop = {name: value for name, value in fields.items() if hasattr(inputs, name)}
        wheel = {name: value for name, value in fields.items() if name not in stop}
        return gate, now_ns, token, replace(status, **wheel), replace(inputs, **stop)

    return (_takes(f"{_GATE}:Gate._stop_rule", change),)


_CLEAR = {"fresh": True, "estop_clear": True, "protective_clear": True}
_LATE_ROWS = ("S01", "S02", "S16", "S27")
CONTROLS: dict[str, Control] = {
    # the gate's rules
    "gate: command_age": Control(
        layer="gate", patches=(_set(f"{_GATE}:COMMAND_MAX_AGE_MS", _FOREVER),), rows=_LATE_ROWS),
    "gate: valid_until": Control(
        layer="gate", patches=(_without(f"{_GATE}:Gate._stop_rule", "valid_until"),), rows=_LATE_ROWS),
    "gate: command_age and valid_until": Control(
        layer="gate",
        patches=(_set(f"{_GATE}:COMMAND_MAX_AGE_MS", _FOREVER), _without(f"{_GATE}:Gate._stop_rule", "valid_until")),
        rows=_LATE_ROWS,
    ),
    "gate: token_age": Control(layer="gate", patches=(_set(f"{_GATE}:TOKEN_MAX_AGE_MS", _FOREVER),), rows=("S05",)),
    "gate: status_age": Control(
        layer="gate", patches=(_set(f"{_GATE}:STATUS_MAX_AGE_MS", _FOREVER),), rows=("S21", "S23", "S19")),
    "gate: not_enabled": Control(layer="gate", patches=_stop_rule(drives_enabled=True), rows=("S06", "S20",
    "S21", "S47")),
    "gate: stop_input": Control(layer="gate", patches=_stop_rule(**_CLEAR), rows=("S33", "S19")),
    "gate: not_finite": Control(
        layer="gate", patches=(_without(f"{_GATE}:Gate._refusal", "not_finite"),), rows=("S14",)),
    "gate: checksum": Control(
        layer="gate", patches=((f"{_GATE}:command_checksum", lambda _old: lambda c: c.checksum),), rows=("S43",)),
    "gate: boot": Control(
        layer="gate", patches=_refusal(lambda g, n, t: (g, replace(n, boot_id=g._boot_id), t)), rows=("S43",)),
    "gate: epoch": Control(
        layer="gate", patches=_refusal(lambda g, n, t: (g, n, t and replace(t, epoch=n.command.epoch))),
        rows=("S43", "S41")),
    "gate: second_writer": Control(
        layer="gate", patches=_refusal(lambda g, n, t: _forget(g, n, t, _writer=None)), rows=("S42", "S41")),
    "gate: sequence": Control(
        layer="gate", patches=_refusal(lambda g, n, t: _forget(g, n, t, _sequence=-1)), rows=("S26", "S27", "S43")),
    "gate: caps": Control(
        layer="gate", patches=(_returns(f"{_GATE}:Gate._cap_scale", 1.0),),
        rows=("S42", "S13", "S10"), phases=("approach", "last_metre")),
    "gate: rate": Control(
        layer="gate", patches=(_returns(f"{_GATE}:Gate._step_s", 10.0),), rows=("S13", "S26", "S11")),
    "gate: window": Control(
        layer="gate", patches=(_returns(f"{_GATE}:Gate._window_share", 1.0),), rows=("S13", "S26", "S11")),
    "gate: measured_jump": Control(layer="gate", patches=(_returns(f"{_GATE}:Gate._jumped", ""),), rows=("S22",)),
    "gate: measured_gap": Control(layer="gate", patches=(_returns(f"{_GATE}:_beyond", False),), rows=("S22", "S40")),
    "gate: measured_stuck": Control(
        layer="gate", patches=(_returns("follower.can_bridge.wheel_tracking:WheelTrackingMonitor.step", False),),
        rows=("S22", "S40"),
        phases=("last_metre", "insert", "retract"),
    ),
    # the arms' gate and the bridge
    "arm gate: age": Control(
        layer="arm gate", patches=(_set(f"{_ARM_GATE}:SETPOINT_MAX_AGE_MS", _FOREVER),), rows=("S49",)),
    "arm gate: jump": Control(
        layer="arm gate", patches=(_set(f"{_ARM_GATE}:MAX_JOINT_STEP_RAD", _FOREVER),), rows=("S22",)),
    "bridge: drive faults": Control(
        layer="bridge", patches=(_returns(f"{_INBOUND}:_axis_faults", []),), rows=("S20",)),
    "bridge: silent drives": Control(
        layer="bridge", patches=(_returns(f"{_INBOUND}:Inbound.silent", []),), rows=("S21",)),
    "bridge: bad frames": Control(
        layer="bridge", patches=(_returns(f"{_INBOUND}:Inbound.bad_frames", ""),), rows=("S23",)),
    "bridge: its own stall": Control(
        layer="bridge", patches=(_returns("follower.can_bridge.drive_bus:DriveBus._check_stall", False),),
        rows=("S06",)),
    "bridge: latched epoch": Control(
        layer="bridge",
        patches=((f"{_BRIDGE}:Bridge.step", lambda old: lambda self, *args: _unlatched(old, self, *args)),),
        rows=("S01", "S41", "S42")),
    # layers that stand in for one another: alone nothing is missed, together it must be
    "gate and supervisor: stop inputs": Control(
        layer="gate and supervisor",
        patches=(*_stop_rule(**_CLEAR), _returns(f"{_SEQUENCE}:DockingSequence._watch", None)),
        rows=("S33",)),
    "gate and bridge: silent drives": Control(
        layer="gate and bridge",
        patches=(_set(f"{_GATE}:STATUS_MAX_AGE_MS", _FOREVER), _returns(f"{_INBOUND}:Inbound.silent", [])),
        rows=("S21",)),
    # the supervisor's guards
    "supervisor: restarted": Control(
        layer="supervisor", patches=_sees(lambda s: replace(s, restarted="")), rows=("S41",)),
    "supervisor: all that ends a docking": Control(
        layer="supervisor", patches=(_returns(f"{_SEQUENCE}:DockingSequence._watch", None),),
        rows=("S33", "S20", "S38", "S41")),
    "supervisor: arms' cause": Control(
        layer="supervisor", patches=_sees(lambda s: replace(s, arms=s.arms and replace(s.arms, cause="ok"))),
        rows=("S38", "S39")),
    "supervisor: contact too early": Control(
        layer="supervisor", patches=_sees(lambda s: replace(s, arms=s.arms and replace(s.arms, connected=False))),
        rows=("S39",)),
    "supervisor: LEDs in sight": Control(
        layer="supervisor", patches=(_returns(f"{_ATTEMPT}:Attempt.blind", ""),), rows=("S03", "S04", "S11", "S35")),
    "supervisor: Follower's health": Control(
        layer="supervisor", patches=(_returns(f"{_ATTEMPT}:Attempt.unwell", ""),), rows=("S46", "S03")),
    "supervisor: lock agrees with odometry": Control(
        layer="supervisor", patches=(_returns("follower.model.dead_reckoning:WheelReckoning.agrees", True),),
        rows=("S13", "S12")),
    "supervisor: wheel slip": Control(
        layer="supervisor", patches=(_returns("follower.supervisor.phases.approach:WheelSlip.step", False),),
        rows=("S40",)),
    "supervisor: reduced speed": Control(
        layer="supervisor",
            patches=(_returns("follower.supervisor.phases.approach:ApproachPhase._missing_leds", ()),),
        rows=("S10",)),
    "supervisor: Leader's lock": Control(
        layer="supervisor", patches=(_returns(f"{_ATTEMPT}:Attempt.leader_unready", ""),),
        rows=("S37",), phases=("idle",)),
    "supervisor: undervoltage at start": Control(
        layer="supervisor", patches=(
            _returns("follower.supervisor.node:undervoltage", ""), _returns(f"{_ATTEMPT}:undervoltage", "")),
        rows=("S46",), phases=("idle",)),
    "supervisor: reports on disk": Control(
        layer="supervisor", patches=(_returns("follower.supervisor.journal:Journal.unfit", ""),),
        rows=("S28",), phases=("idle",)),
    "supervisor: latch": Control(
        layer="supervisor", patches=(_returns(f"{_SEQUENCE}:needs_reset", False),), rows=("S33", "S20", "S39")),
    "supervisor: last metre's cap": Control(
        layer="supervisor", patches=(_set("follower.supervisor.phases.approach:LAST_METRE_M", -10.0),),
        rows=("S26",), phases=("last_metre",)),
    # health checks of estimator, arms, controller, Leader
    "estimator: frozen camera": Control(
        layer="health", patches=(
            _returns("follower.estimator.image_health:ImageHealth.frozen", False),
            _returns("follower.estimator.image_health:ImageFollows.doubted", False)),
        rows=("S08",)),
    "estimator: image follows the wheels": Control(
        layer="health", patches=(_returns("follower.estimator.image_health:ImageFollows.doubted", False),),
        rows=("S08",)),
    "estimator: exposure": Control(
        layer="health", patches=(
            _set("follower.estimator.image_health:_WHITE_PART", 2.0),
            _set("follower.estimator.image_health:_DARKEST", -1.0)),
        rows=("S09",)),
    "estimator: frame's age": Control(
        layer="health", patches=(("follower.estimator.node:FRAME", lambda old: replace(old, max_age_ms=1e9)),),
        rows=("S07",)),
    "arms: collision": Control(
        layer="health", patches=(_returns("follower.arms.collision_detection:CollisionDetector.step", False),),
        rows=("S39",)),
    "arms: slip": Control(
        layer="health", patches=(_returns("follower.arms.slip_detection:SlipDetector.step", False),), rows=("S38",)),
    "controller: solver's status": Control(
        layer="health",
        patches=(("follower.controller.interface:Plan.usable", lambda _old: property(lambda _plan: True)),),
        rows=("S15",)),
    "controller: replayed plans": Control(
        layer="health", patches=(_set("follower.controller.replay:MAX_REPLAYED_PLANS", 40),),
        rows=("S15", "S03", "S04")),
    "Leader: jammed and overdue": Control(
        layer="health", patches=(
            _returns("leader.lock:BoltLock._jammed", False), _returns("leader.lock:BoltLock._overdue", False)),
        rows=("S36",), phases=("push",)),
    "Leader: doubtful switches": Control(
        layer="health", patches=(_returns("leader.lock:BoltLock._check_switches", None),), rows=("S37",),
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
}


def _unlatched(step: Any, bridge: Any, *args: Any) -> Any:
    """A bridge that forgets which epoch it stopped, and the gate what it latched."""
    bridge._stopped_epoch = -1
    bridge._gate._latched = ""
    return step(bridge, *args)
