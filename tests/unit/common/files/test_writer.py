"""Files written beside a loop: in order, whole, bounded, without delaying the loop."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from common.files.writer import BackgroundWriter, replace_file, state_directory


def test_lines_come_in_order_and_files_whole(tmp_path: Path) -> None:
    writer = BackgroundWriter(limit=1000)
    for number in range(100):
        writer.append_line(tmp_path / "new" / "lines", str(number))
        writer.replace(tmp_path / "count", f"{number}\n")
    writer.close(20.0)
    assert (tmp_path / "new" / "lines").read_text().split() == [str(number) for number in range(100)]
    assert (tmp_path / "count").read_text() == "99\n"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    assert writer.fault == ""


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    writer = BackgroundWriter()
    writer.append_line(blocked / "lines", "lost")
    writer.close(20.0)
    assert "file" in writer.fault


def test_a_failed_write_stops_nothing_and_a_good_one_clears_the_fault(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    writer = BackgroundWriter()
    writer.append_line(blocked / "lines", "lost")
    writer.append_line(tmp_path / "lines", "kept")
    writer.close(20.0)
    assert writer.fault == ""
    assert (tmp_path / "lines").read_text() == "kept\n"


def test_the_oldest_waiting_write_is_dropped_when_too_many_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, disk_ready = threading.Event(), threading.Event()

    def slow_disk(_descriptor: int) -> None:
        begun.set()
        disk_ready.wait(20.0)

    monkeypatch.setattr("os.fsync", slow_disk)
    writer = BackgroundWriter(limit=2)
    writer.replace(tmp_path / "slow", "")
    assert begun.wait(20.0)
    for line in ("first", "second", "third"):
        writer.append_line(tmp_path / "lines", line)
    disk_ready.set()
    writer.close(20.0)
    assert (tmp_path / "lines").read_text().split() == ["second", "third"]


def test_a_failed_replacement_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "count"
    replace_file(path, "old\n")

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, "new\n")
    assert path.read_text() == "old\n"


def test_a_line_that_a_power_cut_tore_takes_no_other_with_it(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    for cut in range(8):
        path.write_bytes(b"first\n" + b"second\n"[:cut])
        writer = BackgroundWriter()
        writer.append_line(path, "third")
        writer.close(20.0)
        assert path.read_text().splitlines()[0] == "first"
        assert path.read_text().splitlines()[-1] == "third"


def test_a_line_is_on_the_disk_when_it_counts_as_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed = []

    def fsync(descriptor: int) -> None:
        flushed.append(os.readlink(f"/proc/self/fd/{descriptor}"))

    monkeypatch.setattr("os.fsync", fsync)
    for _ in range(2):
        writer = BackgroundWriter()
        writer.append_line(tmp_path / "lines", "text")
        writer.close(20.0)
    replace_file(tmp_path / "count", "1")
    assert flushed == [
        str(tmp_path / "lines"),
        str(tmp_path),
        str(tmp_path / "lines"),
        str(tmp_path / ".count.new"),
        str(tmp_path),
    ]


def test_a_text_that_is_not_unicode_is_named_and_stops_nothing(tmp_path: Path) -> None:
    writer = BackgroundWriter()
    writer.append_line(tmp_path / "lines", "\ud800")
    writer.append_line(tmp_path / "lines", "kept")
    writer.close(20.0)
    assert (tmp_path / "lines").read_text() == "kept\n"


def test_the_state_lies_where_it_is_configured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert state_directory("", tmp_path) == tmp_path
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/davpc:/var/lib/other")
    assert state_directory("", tmp_path) == Path("/var/lib/davpc")
    assert state_directory("/srv/davpc", tmp_path) == Path("/srv/davpc")
