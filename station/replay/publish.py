"""A recording onto a bus, for whatever listens: displays, tools, one process under test."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.channels import CHANNELS, Channel
from common.errors import DeviceError
from common.messages import Command, Header, MessageError, decode, encode, seal_command
from common.recording.recording import Recording
from common.timing import NS_PER_S, MonotonicClock

_DURATIONS = ("image_to_can_ns",)
_SETTLE_NS = NS_PER_S // 2


def published(recording: Recording) -> Iterator[tuple[int, Channel[Any], Header, Any]]:
    """Every state of the channels' table in the order of receipt, with its time."""
    states = [channel for channel in CHANNELS if channel.kind == "state"]
    records = sorted(
        (
            (record.log_ns, channel, record.data)
            for channel in states
            for record in recording.topics.get(channel.key, ())
        ),
        key=lambda found: found[0],
    )
    for log_ns, channel, data in records:
        try:
            yield log_ns, channel, *decode(channel.message, data)
        except MessageError:
            continue


def shifted(message: Any, by_ns: int) -> Any:
    """The message with its stamps moved, so that it is as old now as it was then."""
    stamps = [item.name for item in fields(message) if item.name.endswith("_ns") and item.name not in _DURATIONS]
    moved = replace(message, **{name: max(0, getattr(message, name) + by_ns) for name in stamps})
    return seal_command(moved) if isinstance(moved, Command) else moved


def publish(
    recording: Recording, runtime: Path, namespace: str, speed: float, ended: Callable[[], bool] = lambda: False
) -> int:
    """Publish every state at its time, stamped as of now.

    Args:
        recording: what to publish.
        runtime: private directory of the mesh's sockets.
        namespace: of the keys.
        speed: times as fast as it was.
        ended: whether to stop early.

    Returns:
        The number of messages.

    Raises:
        DeviceError: processes of a robot run there: two publishers of one key would mix.
    """
    clock, count = MonotonicClock(), 0
    name = f"replay-{secrets.token_hex(3)}"
    peers = sorted(path.stem for path in runtime.glob("*.sock"))
    with Bus(name, runtime, peers, namespace) as bus:
        clock.sleep_until(clock.now_ns() + _SETTLE_NS)
        publishers = {channel.publisher for channel in CHANNELS if channel.kind == "state"}
        busy = bus.alive() & publishers
        if busy:
            raise DeviceError(f"{runtime}: {sorted(busy)[0]} runs here: a replay does not publish beside a robot")
        begun_ns, first_ns = clock.now_ns(), None
        for log_ns, channel, header, message in published(recording):
            first_ns = log_ns if first_ns is None else first_ns
            if ended():
                break
            due_ns = begun_ns + round((log_ns - first_ns) / speed)
            clock.sleep_until(due_ns)
            stamp = replace(header, stamp_ns=max(0, header.stamp_ns + due_ns - log_ns), boot_id=clock.boot_id)
            bus.publish(channel, encode(shifted(message, due_ns - log_ns), stamp))
            count += 1
    for path in runtime.glob(f"{name}.*"):
        path.unlink(missing_ok=True)
    return count
