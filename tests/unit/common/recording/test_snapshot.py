"""A node's state comes back as it was; a file from a stranger makes nothing run."""

from __future__ import annotations

import os
import pickle
import zlib
from pathlib import Path
from typing import Any

import msgpack
import pytest

from common.channels import DRIVES
from common.messages import NodeSnapshot
from common.node import Inbox, Node, Trigger
from common.recording.journal import JournalWriter
from common.recording.snapshot import SnapshotError, restore, take


class Counting(Node):
    """Keeps a number, a device and a clock."""

    name = "follower-arms"
    trigger = Trigger(1)

    def __init__(self, device: Any) -> None:
        self.count, self.device, self.noise = 0, device, b""

    def step(self, now_ns: int, inputs: Inbox) -> tuple[()]:  # noqa: ARG002
        self.count += 1
        return ()


def test_state_and_inbox_come_back_and_devices_stay_outside() -> None:
    node = Counting(JournalWriter().device("bus", open))
    node.count, node.noise = 7, os.urandom(150_000)
    inbox = Inbox("boot")
    inbox.put_state(DRIVES, b"payload", 5)
    inbox.begin_step()
    parts = take(node, inbox, 3)
    assert len(parts) > 1
    assert {part.step for part in parts} == {3}
    other, empty = Counting("old"), Inbox("boot")
    restore(parts, other, empty, {"bus": "stand-in"})
    assert (other.count, other.device, other.noise) == (7, "stand-in", node.noise)
    assert empty.kept() == inbox.kept()
    with pytest.raises(SnapshotError, match="a part of the snapshot is missing"):
        restore(parts[1:], other, empty, {"bus": None})
    with pytest.raises(SnapshotError, match="no device 'bus'"):
        restore(parts, other, empty, {})


class Evil:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("where", ["mkdir", "ours"])
def test_a_strangers_snapshot_runs_nothing(tmp_path: Path, where: str) -> None:
    path = tmp_path / "made"
    function = b"ccommon.files.writer\nreplace_file\n."  # of this repository, but no type
    pickled = pickle.dumps(Evil(path)) if where == "mkdir" else function
    packed = zlib.compress(msgpack.packb((pickled, {}, {})))
    with pytest.raises(SnapshotError, match="which no node's state holds"):
        restore([NodeSnapshot(0, 0, 1, packed)], Counting(None), Inbox(None), {})
    assert not path.exists()


@pytest.mark.parametrize("state", [b"", b"garbage", zlib.compress(b"\xc1"), zlib.compress(msgpack.packb((b"", 1)))])
def test_damaged_state_is_one_line(state: bytes) -> None:
    with pytest.raises(SnapshotError) as caught:
        restore([NodeSnapshot(0, 0, 1, state)], Counting(None), Inbox(None), {})
    assert "\n" not in str(caught.value)
