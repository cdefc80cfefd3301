"""Faults of processes, messages, clocks, disks, configuration, and whoever else speaks."""

from __future__ import annotations

import json
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack

from common.channels import (
    ARM_SETPOINT,
    ARM_STATE,
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_GATEWAY,
    LEADER_GATEWAY,
    MISSION,
    Channel,
)
from common.config import Config
from common.messages import DockRequest, GatewayState
from common.timing import NS_PER_MS, NS_PER_S
from experiments.campaign.stage import Stage
from follower.controller.interface import PlanStatus, failed_plan

LASTING_S = 1.5
_HUNG_S, _DOWN_S = 0.4, 0.2
_FOLLOWER = ("camera", "estimator", "controller", "arms", "supervisor", "can-bridge")
BRIDGE, CONTROLLER, SUPERVISOR = "follower-can-bridge", "follower-controller", "follower-supervisor"
Fault = Callable[[Stage], None]


def _halt(name: str, for_s: float | None = None) -> Fault:
    def fault(stage: Stage) -> None:
        stage.executor.halt(name)
        if for_s is not None:
            stage.later(for_s, lambda: stage.executor.resume(name))

    return fault


def _restart(name: str) -> Fault:
    def fault(stage: Stage) -> None:
        stage.executor.halt(name)
        stage.later(_DOWN_S, lambda: stage.restart(name))

    return fault


def _computer_off(stage: Stage) -> None:
    for name in _FOLLOWER:
        stage.executor.halt(f"follower-{name}")


def _late_loops(stage: Stage) -> None:
    """Every loop of the Follower comes 30 ms late, again and again."""
    begin_ns = stage.clock.now_ns()

    def overload() -> None:
        late = (stage.clock.now_ns() - begin_ns) // NS_PER_MS % 60 < 30
        for name in _FOLLOWER:
            (stage.executor.halt if late else stage.executor.resume)(f"follower-{name}")

    def over() -> None:
        for name in _FOLLOWER:
            stage.executor.resume(f"follower-{name}")

    stage.every(overload, LASTING_S)
    stage.later(LASTING_S + 0.02, over)  # the last look may have halted them


def between(receiver: str, channel: Channel[Any], pass_on: Callable[..., None]) -> Fault:
    """What a process receives on a channel goes through ``pass_on(stage, payload, put)`` for a while."""

    def fault(stage: Stage) -> None:
        box: Any = stage.inbox(receiver)
        put_state = box.put_state
        over: list[bool] = []
        stage.later(LASTING_S, lambda: over.append(True))

        def put(received: Channel[Any], payload: bytes, receipt_ns: int) -> None:
            if received is channel and not over:
                pass_on(stage, payload, lambda content: put_state(channel, content, receipt_ns))
            else:
                put_state(received, payload, receipt_ns)

        box.put_state = put

    return fault


def _nan(field: str) -> Callable[..., None]:
    """The message with a NaN, and a checksum that fits."""

    def pass_on(stage: Stage, payload: bytes, put: Callable[[bytes], None]) -> None:
        del stage
        schema, header, body, _ = msgpack.unpackb(payload)
        body[field] = float("nan")
        put(msgpack.packb([schema, header, body, zlib.crc32(msgpack.packb([header, body]))]))

    return pass_on


def _nan_everywhere(channel: Channel[Any], field: str) -> Fault:
    """Whoever receives the channel gets it with a NaN."""

    def fault(stage: Stage) -> None:
        for name, running in stage.running.items():
            if channel in running.node.inputs and name != "station":
                between(name, channel, _nan(field))(stage)

    return fault


def _solver_fails(stage: Stage) -> None:
    solver = stage.node(CONTROLLER)._method._controller
    horizon = stage.config.controller.horizon
    solver.solve = lambda *_args, **_named: failed_plan(PlanStatus.NUMERICAL_FAILURE, horizon, 3)


def _solver_late(stage: Stage) -> None:
    """Every command of the controller is ready 60 ms after its step began."""
    node, clock = stage.node(CONTROLLER), stage.clock

    class Late:
        boot_id = clock.boot_id

        def now_ns(self) -> int:
            return clock.now_ns() + 60 * NS_PER_MS

    node._clock = Late()


def _clock_jumps(stage: Stage) -> None:
    true = time.time
    off_s = stage.random.choice((-3600.0, 3600.0))
    time.time = lambda: true() + off_s


def _disk_full(stage: Stage) -> None:
    for name, path in ((SUPERVISOR, "_journal"), ("leader", "")):
        holder = getattr(stage.node(name), path) if path else stage.node(name)
        holder._writer.full = True
    stage.node(SUPERVISOR)._journal._probed_ns = None


def _certificate(stage: Stage) -> None:
    """An hour is left of either robot's certificate."""
    count = [0]

    def tell() -> None:
        if count[0] % 50 == 0:
            for channel in (FOLLOWER_GATEWAY, LEADER_GATEWAY):
                stage.publish(channel, GatewayState(linked=True, certificate_left_s=3600.0, rules=""))
        count[0] += 1

    stage.every(tell)


def _abort(stage: Stage) -> None:
    stage.publish(DOCK_REQUEST, DockRequest("stop", stage.clock.now_ns() + NS_PER_S, "abort"))


def _configured(section: str, **values: float) -> Fault:
    """Whether a configuration with such values is accepted at all."""

    def fault(stage: Stage) -> None:
        assert stage.trace is not None
        table = stage.config.model_dump(mode="json")
        Config.model_validate_json(json.dumps(table))
        table[section].update(values)
        if section == "follower_can":
            table[section]["left_wheel"]["gear_ratio"] = 1e-9
        try:
            Config.model_validate_json(json.dumps(table))
        except ValueError:
            stage.trace.outcome = "refuse"
        else:
            stage.trace.outcome = "moved"

    return fault


FAULTS: dict[str, Fault] = {
    **{f"{name}_dead": _halt(f"follower-{name}") for name in ("controller", "estimator", "supervisor", "arms")},
    **{
        f"{name}_hung": _halt(f"follower-{name}", _HUNG_S)
        for name in ("controller", "estimator", "supervisor", "arms")
    },
    "bridge_dead": _halt(BRIDGE),
    "bridge_hung": _halt(BRIDGE, _HUNG_S),
    **{f"restart_{name.removeprefix('can-')}": _restart(f"follower-{name}") for name in _FOLLOWER},
    "computer_off": _computer_off,
    "late_loops": _late_loops,
    "nan_command": between(BRIDGE, COMMAND, _nan("v_m_s")),
    "nan_mission": between(BRIDGE, MISSION, _nan("v_max_m_s")),
    "nan_state": _nan_everywhere(DOCKING_STATE, "x_m"),
    "nan_drives": _nan_everywhere(DRIVES, "v_set_m_s"),
    "nan_arms": _nan_everywhere(ARM_STATE, "handle_force_n"),
    "nan_torques": _nan_everywhere(ARM_SETPOINT, "lift_m"),
    "theta_flip": lambda stage: _falsify(stage, "theta_rad", 0.5),
    "depth_jump": lambda stage: _falsify(stage, "x_m", 0.6),
    "solver_fails": _solver_fails,
    "solver_late": _solver_late,
    "clock_jumps": _clock_jumps,
    "disk_full": _disk_full,
    "certificate": _certificate,
    "link_cut": lambda stage: stage.executor.cut_link(stage.clock.now_ns()),
    "abort": _abort,
    "config_radius": _configured("base", wheel_radius_m=1e-300),
    "config_gear": _configured("follower_can"),
    "config_cap": _configured("limits", v_max_m_s=5.0),
    "calibration_missing": lambda _stage: None,
}


def _falsify(stage: Stage, field: str, offset: float) -> None:
    """For a second every docking state is off by so much."""
    estimator = stage.node("follower-estimator")
    step = estimator.step
    over: list[bool] = []
    stage.later(1.0, lambda: over.append(True))

    def falsified(now_ns: int, inputs: Any) -> list[Any]:
        return [
            (channel, message if over or channel is not DOCKING_STATE
             else replace(message, **{field: getattr(message, field) + offset}))
            for channel, message in step(now_ns, inputs)
        ]  # fmt: skip

    estimator.step = falsified
