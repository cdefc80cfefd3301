"""Messages that are repeated, late or out of order, and those of a second or a forged sender."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from common.channels import COMMAND, DOCKING_STATE, MISSION, Channel
from common.messages import Command, seal_command
from common.node import Outbox
from common.timing import NS_PER_S
from experiments.campaign.faults.message import BRIDGE, CONTROLLER, LASTING_S, Fault, between
from experiments.campaign.stage import Stage

_ROGUE_M_S = 0.4


def _reordered() -> Fault:
    kept: list[bytes] = []

    def pass_on(stage: Stage, payload: bytes, put: Callable[[bytes], None]) -> None:
        put(payload)
        for old in kept[-1:]:
            stage.later(0.0, lambda old=old: put(old))  # type: ignore[misc]
        kept.append(payload)

    return between(BRIDGE, COMMAND, pass_on)


def _doubled(receiver: str, channel: Channel[Any]) -> Fault:
    def pass_on(stage: Stage, payload: bytes, put: Callable[[bytes], None]) -> None:
        put(payload)
        stage.later(0.0, lambda: put(payload))

    return between(receiver, channel, pass_on)


def _burst(stage: Stage) -> None:
    """Commands are held back for 0.7 s, and then come all at once, in two orders."""
    held: list[bytes] = []
    box: Any = stage.inbox(BRIDGE)
    put_state = box.put_state
    over: list[bool] = []

    def put(channel: Channel[Any], payload: bytes, receipt_ns: int) -> None:
        if channel is COMMAND and not over:
            held.append(payload)
        else:
            put_state(channel, payload, receipt_ns)

    def release() -> None:
        over.append(True)
        for payload in (*held, *reversed(held)):
            put_state(COMMAND, payload, stage.clock.now_ns())

    box.put_state = put
    stage.later(0.7, release)


def _intruder(make: Callable[[Stage, Command], Command], same_run: bool = True, boot_id: str = "") -> Fault:
    """Another process's commands reach the bridge 33 times a second, never in step with the controller's 20."""

    def fault(stage: Stage) -> None:
        box, clock = stage.inbox(BRIDGE), stage.clock
        genuine = stage.running[CONTROLLER].outbox._run_id
        outbox = Outbox(CONTROLLER, genuine if same_run else 987_654, boot_id or clock.boot_id)
        count = [0]

        def speak() -> None:
            count[0] += 1
            newest, mission = box.newest(COMMAND), box.newest(MISSION)
            if count[0] % 3 or newest is None or mission is None:
                return
            now_ns, epoch = clock.now_ns(), mission.message.epoch
            command = Command(_ROGUE_M_S, 0.0, epoch, 10**6 + count[0], now_ns, now_ns + NS_PER_S // 10, 1, now_ns)
            box.put_state(COMMAND, outbox.pack(COMMAND, make(stage, command), now_ns), now_ns)

        stage.every(speak, LASTING_S)

    return fault


def _replay(stage: Stage) -> None:
    """What the controller said a second ago comes again, to the bit."""
    box: Any = stage.inbox(BRIDGE)
    kept: list[bytes] = []
    put_state = box.put_state

    def put(channel: Channel[Any], payload: bytes, receipt_ns: int) -> None:
        put_state(channel, payload, receipt_ns)
        if channel is COMMAND:
            kept.append(payload)
            if len(kept) > 4:
                stage.later(0.0, lambda: put_state(COMMAND, kept[-5], stage.clock.now_ns()))

    box.put_state = put


FAULTS: dict[str, Fault] = {
    "commands_reordered": _reordered(),
    "commands_doubled": _doubled(BRIDGE, COMMAND),
    "states_doubled": _doubled(CONTROLLER, DOCKING_STATE),
    "burst": _burst,
    "second_controller": _intruder(lambda _stage, command: seal_command(command), same_run=False),
    "old_epoch": _intruder(lambda _stage, command: seal_command(replace(command, epoch=command.epoch - 1))),
    "forged": _intruder(lambda _stage, command: replace(command, checksum=12345)),
    "other_boot": _intruder(lambda _stage, command: seal_command(command), boot_id="another"),
    "replay": _replay,
}
