"""What a command receives of a running robot: the newest of each channel, or everything in order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest

from common.bus import Bus
from common.channels import ARM_STATE, LEADER_STATE, MISSION, Channel
from common.messages import ArmState, Message, MessageError
from common.node import Outbox
from common.timing import NS_PER_S, SteppedClock
from station.operate.link import Stream, Watch

ARMS = ArmState(handle_force_n=0.0, contact=False, connected=False, gripped=False, released=True)


class PlayedBus:
    """Passes on what the test publishes."""

    def __init__(self) -> None:
        self.receivers: dict[str, Callable[[bytes], None]] = {}

    def subscribe(self, channel: Channel[Any], on_payload: Callable[[bytes], None]) -> None:
        self.receivers[channel.key] = on_payload

    stream = subscribe


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock()


def packed(channel: Channel[Any], message: Message, clock: SteppedClock) -> bytes:
    return Outbox("follower-arms", 1, clock.boot_id).pack(channel, message, clock.now_ns())


def test_a_watch_has_the_newest_of_each_channel(clock: SteppedClock) -> None:
    bus = PlayedBus()
    watch = Watch(cast(Bus, bus), clock, (ARM_STATE, LEADER_STATE))
    assert watch.newest(ARM_STATE) is None
    bus.receivers[ARM_STATE.key](packed(ARM_STATE, ARMS, clock))
    assert watch.newest(ARM_STATE) == ARMS
    assert not watch.wait(0.0), "nothing of the Leader has come"
    bus.receivers[ARM_STATE.key](b"of another version")
    assert watch.newest(ARM_STATE) == ARMS
    clock.advance_to(clock.now_ns() + 10 * NS_PER_S)
    assert (watch.newest(ARM_STATE), watch.fresh(ARM_STATE)) == (ARMS, None)
    watch.forget()
    assert watch.newest(ARM_STATE) is None


def test_a_stream_has_everything_in_order(clock: SteppedClock) -> None:
    bus = PlayedBus()
    stream = Stream(cast(Bus, bus), (ARM_STATE, MISSION))
    bus.receivers[ARM_STATE.key](packed(ARM_STATE, ARMS, clock))
    bus.receivers[MISSION.key](b"of another version")
    item = stream.next(0.0)
    assert item is not None
    channel, header, message = item
    assert (channel, header.stamp_ns, message) == (ARM_STATE, clock.now_ns(), ARMS)
    with pytest.raises(MessageError, match=MISSION.key):
        stream.next(0.0)
    assert stream.next(0.0) is None
