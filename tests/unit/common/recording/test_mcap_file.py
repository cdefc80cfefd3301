"""Recordings: what a strict reader and a crash make of them."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.errors import ConfigError
from common.recording.mcap_file import Note, Recorded, RunWriter, TornEnd, read_file
from tests.rigs.recorded_run import recorded_run

MESSAGES = [(f"topic/{number % 3}", bytes([number % 251]) * (number % 700), 10 * number) for number in range(1, 2001)]


def written(*, compressed: bool = True, flush_every: int = 100, closed: bool = True) -> bytes:
    stream = io.BytesIO()
    writer = RunWriter(stream, compressed=compressed)
    writer.note("about", {"seed": "1"})
    for number, (topic, data, time_ns) in enumerate(MESSAGES):
        writer.declare(topic, "msgpack")
        writer.add(topic, data, time_ns, time_ns - 1)
        if number % flush_every == flush_every - 1:
            writer.flush()
    if closed:
        writer.close()
    return stream.getvalue()


def read(path: Path, content: bytes) -> tuple[list[tuple[str, bytes, int]], list[TornEnd]]:
    path.write_bytes(content)
    records = list(read_file(path))
    messages = [(r.topic, r.data, r.log_ns) for r in records if isinstance(r, Recorded)]
    return messages, [r for r in records if isinstance(r, TornEnd)]


@pytest.mark.parametrize("compressed", [True, False])
def test_what_is_written_comes_back(tmp_path: Path, compressed: bool) -> None:
    content = written(compressed=compressed)
    assert read(tmp_path / "a.mcap", content) == (MESSAGES, [])
    assert content == written(compressed=compressed), "the same input makes the same file"
    notes = [record for record in read_file(tmp_path / "a.mcap") if isinstance(record, Note)]
    assert notes == [Note("about", {"seed": "1"})]


def test_a_file_cut_anywhere_gives_all_before_the_last_flush(tmp_path: Path) -> None:
    chance = random.Random(3)
    content = written(closed=False)
    for _ in range(60):
        cut = chance.randrange(len(content) // 10, len(content))
        messages, torn = read(tmp_path / "cut.mcap", content[:cut])
        assert messages == MESSAGES[: len(messages)]
        assert torn
    messages, torn = read(tmp_path / "cut.mcap", content)
    assert messages == MESSAGES, "a crash after a flush loses nothing"
    assert torn


def test_a_flipped_byte_ends_the_file_with_a_reason(tmp_path: Path) -> None:
    content = bytearray(written())
    content[len(content) // 2] ^= 0x10
    messages, torn = read(tmp_path / "flipped.mcap", bytes(content))
    assert messages == MESSAGES[: len(messages)]
    assert len(messages) < len(MESSAGES)
    assert torn[0].reason


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"not a recording at all"])
def test_what_is_no_recording_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"x\.mcap: not an MCAP file"):
        list(read_file(path))
    with pytest.raises(ConfigError, match="cannot be read"):
        list(read_file(tmp_path / "missing.mcap"))


def test_the_librarys_strict_reader_takes_a_whole_docking() -> None:
    for path in (recorded_run(), recorded_run().with_suffix(".frames.mcap")):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            count = sum(1 for _ in reader.iter_messages())
            assert count == summary.statistics.message_count > 100
