"""Which part of the stream becomes a file, what it is called, and what goes when the disk is full."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from common.channels import COMMAND, MISSION
from common.config import RecorderConfig
from common.messages import Header, Mission, Phase, encode
from common.recording.run import Item
from common.timing import NS_PER_S
from follower.recorder.attempts import AttemptFiles
from follower.recorder.retention import superfluous


def mission(phase: Phase, at_s: float, cause: str = "") -> Item:
    message = Mission(phase, cause, 2, 1, True, "hold", 0.0, 0.0, 0.0, 0.0, (), "stay", False, 0)
    at_ns = round(at_s * NS_PER_S)
    return Item(MISSION.key, encode(message, Header("s", 1, 1, at_ns, "b")), at_ns)


def other(at_s: float) -> Item:
    return Item(COMMAND.key, b"x", round(at_s * NS_PER_S))


class Files:
    """Stands for files; keeps what it takes."""

    def __init__(self, path: Path) -> None:
        path.write_bytes(b"")
        self.items: list[Item] = []
        self.dropped: dict[str, int] = {}
        self.size_bytes = 0
        self.closed = self.full = False

    def take(self, item: Item) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.items.append(item)

    def drop(self, key: str, count: int) -> None:
        self.dropped[key] = count

    def flush(self) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        self.closed = True


class Rig:
    """Attempts with their files."""

    def __init__(self, folder: Path, **settings: float) -> None:
        self.opened: list[Files] = []
        self.folder = folder / "recordings"
        self.attempts = AttemptFiles(self.folder, RecorderConfig(**settings), self._open, lambda: "T")  # type: ignore[arg-type]

    def _open(self, path: Path) -> Files:
        self.opened.append(Files(path))
        return self.opened[-1]

    def names(self) -> list[str]:
        return sorted(path.name for path in self.folder.glob("*"))


def drive(rig: Rig, end: Phase, cause: str) -> None:
    for tenth in range(600):
        at_s = tenth / 10
        phase: Phase = "idle" if at_s < 20 else "approach" if at_s < 40 else end
        rig.attempts.take(mission(phase, at_s, cause if phase == end else ""))
        rig.attempts.take(other(at_s))


@pytest.mark.parametrize(
    ("end", "cause", "name"),
    [("done", "", "T-K2-docked.mcap"), ("aborted", "leds_lost: 3 searches", "T-K2-leds_lost.mcap")],
)
def test_a_docking_is_kept_with_ten_seconds_before_and_two_after(
    tmp_path: Path, end: Phase, cause: str, name: str
) -> None:
    rig = Rig(tmp_path)
    drive(rig, end, cause)
    (files,) = rig.opened
    assert files.closed
    assert files.items[0].receipt_ns == 10 * NS_PER_S
    assert files.items[-1].receipt_ns == 42 * NS_PER_S
    assert rig.names() == [name]


def test_a_file_is_a_part_until_its_docking_ends(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.attempts.take(mission("approach", 1.0))
    assert rig.names() == ["T-K2.part.mcap"]
    rig.attempts.close()
    assert rig.names() == ["T-K2-stopped.mcap"]


def test_what_was_dropped_before_a_docking_is_noted_in_its_file(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.attempts.drop("a", 3)
    rig.attempts.take(mission("approach", 1.0))
    assert rig.opened[0].dropped == {"a": 3}
    rig.attempts.drop("b", 1)
    assert rig.opened[0].dropped == {"a": 3, "b": 1}


def test_a_full_disk_ends_the_file_and_the_next_docking_is_tried_again(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.attempts.take(mission("approach", 1.0))
    rig.opened[0].full = True
    rig.attempts.flush()
    for at_s in (2.0, 3.0):
        rig.attempts.take(mission("approach", at_s))
    assert len(rig.opened) == 1, "not over and over"
    rig.attempts.take(mission("aborted", 4.0, "gate_stop"))
    rig.attempts.take(mission("approach", 5.0))
    assert len(rig.opened) == 2


def test_a_folder_that_cannot_be_made_stops_nothing(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.folder.parent.joinpath("recordings").write_text("a file is in the way")
    rig.attempts.take(mission("approach", 1.0))
    assert not rig.attempts.recording


def test_a_docking_without_end_is_cut(tmp_path: Path) -> None:
    rig = Rig(tmp_path, longest_s=60.0)
    for at_s in range(0, 100, 10):
        rig.attempts.take(mission("approach", float(at_s)))
    assert rig.opened[0].closed
    assert "T-K2-too_long.mcap" in rig.names()


def test_the_oldest_go_first_and_the_failed_last(tmp_path: Path) -> None:
    for name in ("1-K1-leds_lost", "2-K1-docked", "3-K2-docked", "4-K3.part"):
        (tmp_path / f"{name}.mcap").write_bytes(bytes(100))
    (tmp_path / "2-K1-docked.frames.mcap").write_bytes(bytes(1000))
    assert superfluous(tmp_path, 2000) == []
    assert [path.name for path in superfluous(tmp_path, 300)] == ["2-K1-docked.mcap"]
    gone = [path.name for path in superfluous(tmp_path, 150)]
    assert gone == ["2-K1-docked.mcap", "3-K2-docked.mcap", "1-K1-leds_lost.mcap"]
