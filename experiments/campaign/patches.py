"""How a control takes a check out: what it replaces as text, so that one that does not fit the code is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

Patch = tuple[str, Callable[[Any], Any]]
GATE, SEQUENCE = "follower.can_bridge.gate", "follower.supervisor.sequence"


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


def becomes(target: str, value: Any) -> Patch:
    return target, lambda _old: value


def returns(target: str, value: Any) -> Patch:
    return target, lambda _old: lambda *_args, **_named: value


def takes(target: str, change: Callable[..., tuple[Any, ...]]) -> Patch:
    """The function gets what ``change`` makes of its arguments."""

    def make(old: Any) -> Any:
        return lambda *args: old(*change(*args))

    return target, make


def without(target: str, rule: str) -> Patch:
    """The function never names this rule."""
    return target, lambda old: lambda *args: "" if (named := old(*args)) == rule else named


def refusal_sees(change: Callable[[Any, Any, Any], tuple[Any, ...]]) -> tuple[Patch, ...]:
    """A rule of what the gate takes, blinded: gate, command and token as the rule is to see them."""
    return (takes(f"{GATE}:Gate._refusal", change),)


def supervisor_sees(change: Callable[[Any], Any]) -> tuple[Patch, ...]:
    """A guard of the supervisor, blinded: it sees what ``change`` makes of the observation."""
    return (takes(f"{SEQUENCE}:DockingSequence.step", lambda self, seen: (self, change(seen))),)


def forget(gate: Any, newest: Any, token: Any, **fields: Any) -> tuple[Any, ...]:
    for name, value in fields.items():
        setattr(gate, name, value)
    return gate, newest, token


def stop_rule_sees(**fields: Any) -> tuple[Patch, ...]:
    """Rules of the gate that look at wheels or stop inputs see these values instead."""

    def change(gate: Any, now_ns: int, token: Any, status: Any, inputs: Any) -> tuple[Any, ...]:
        stop = {name: value for name, value in fields.items() if hasattr(inputs, name)}
        wheel = {name: value for name, value in fields.items() if name not in stop}
        return gate, now_ns, token, replace(status, **wheel), replace(inputs, **stop)

    return (takes(f"{GATE}:Gate._stop_rule", change),)


def unlatched(step: Any, bridge: Any, *args: Any) -> Any:
    """A bridge that forgets which epoch it stopped, and the gate what it latched."""
    bridge._stopped_epoch = -1
    bridge._gate._latched = ""
    return step(bridge, *args)
