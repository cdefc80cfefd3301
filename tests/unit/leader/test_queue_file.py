"""The file that keeps the number of trolleys in the queue."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from leader.queue_file import content, read


def test_the_count_is_kept_and_a_file_that_makes_no_sense_is_not_known(tmp_path: Path) -> None:
    path = tmp_path / "queue.json"
    assert read(path).count == 0
    for count in (None, 0, 7):
        path.write_text(content(count))
        assert read(path) == replace(read(path), count=count, warning="")
    for spoilt in ("", "{", "[]", content(7).replace("7", "-7"), content(7).replace("queue/1", "queue/9"), "\udcff"):
        path.write_text(spoilt, errors="surrogateescape")
        assert read(path).count is None
        assert "enter the count" in read(path).warning
