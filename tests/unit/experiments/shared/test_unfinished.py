"""Kept results survive a cut at any byte, odd line separators and other calls in the same folder."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import pytest

from common.errors import ConfigError
from experiments.shared.unfinished import FOLDER, Unfinished, file_of, finished


@dataclass(frozen=True)
class Note:
    number: int
    text: str
    parts: tuple[str, ...] = ()


NOTES = [Note(1, "a line\u2028and\x85another\n"), Note(2, "ß", ("x", "y")), Note(3, "")]


def kept(tmp_path: Path, notes: list[Note] = NOTES) -> Unfinished[Note]:
    file = Unfinished(file_of(tmp_path, "notes", 1), Note)
    file.keep(notes)
    return file


def test_a_file_that_was_cut_at_any_byte_loses_no_more_than_its_last_line_and_takes_more(tmp_path: Path) -> None:
    file = kept(tmp_path)
    data = file.file.read_bytes()
    ends = [place for place, byte in enumerate(data) if byte == ord("\n")]
    for cut in range(len(data)):
        for rest in (b"", b"\0" * 40):
            file.file.write_bytes(data[:cut] + rest)
            whole = NOTES[: sum(end <= cut - bool(rest) for end in ends)]
            assert file.read() == whole
            file.keep(NOTES[2:])
            assert file.read() == [*whole, NOTES[2]]


def test_a_line_of_another_form_is_left_out_with_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = kept(tmp_path)
    odd = b'\n[]\n{"number": "x", "text": 1}\n\xff\xfe\nnull\n' + b"[" * 100_000 + b"\n"
    file.file.write_bytes(odd + file.file.read_bytes())
    with caplog.at_level(logging.WARNING):
        assert file.read() == NOTES
    (record,) = caplog.records
    assert "5 damaged results" in record.message
    assert file.read() == NOTES


def test_another_call_in_the_same_folder_keeps_its_files(tmp_path: Path) -> None:
    mine, other = kept(tmp_path), Unfinished(file_of(tmp_path, "notes", 2), Note)
    other.keep(NOTES)
    finished([mine.file])
    assert (mine.read(), other.read()) == ([], NOTES)
    finished([other.file])
    assert not (tmp_path / FOLDER).exists()


def test_a_file_that_cannot_be_used_is_one_line(tmp_path: Path) -> None:
    file = Unfinished(file_of(tmp_path, "notes", 1), Note)
    file.file.mkdir()
    with pytest.raises(ConfigError, match=f"{file.file}: cannot be"):
        file.read()
    with pytest.raises(ConfigError, match="cannot be written"):
        file.keep(NOTES)
