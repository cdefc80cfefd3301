"""A recording published again is as old as it was."""

from __future__ import annotations

from common.channels import COMMAND
from common.messages import Command, command_checksum
from common.recording.recording import Recording
from station.replay.publish import published, shifted
from tests.rigs.recorded_run import recorded_run


def test_everything_comes_in_the_order_of_receipt() -> None:
    recording = Recording.read(recorded_run())
    messages = list(published(recording))
    times = [log_ns for log_ns, *_ in messages]
    assert times == sorted(times)
    assert {channel.key for _, channel, *_ in messages} >= {COMMAND.key, "follower/camera/frame", "leader/state"}


def test_stamps_move_together_and_durations_stay() -> None:
    recording = Recording.read(recorded_run())
    for _, channel, _, message in published(recording):
        moved = shifted(message, 1_000)
        if isinstance(message, Command):
            assert moved.valid_until_ns - moved.stamp_ns == message.valid_until_ns - message.stamp_ns
            assert moved.capture_ns == message.capture_ns + 1_000
            assert moved.checksum == command_checksum(moved)
        if channel.key == "follower/state/drives":
            assert moved.image_to_can_ns == message.image_to_can_ns
            assert moved.measured_ns == message.measured_ns + 1_000
