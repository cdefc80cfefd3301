"""Frames cross by shared memory whole, or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.errors import DeviceError
from common.frames.ring import SLOTS, FrameReader, FrameRing
from common.messages import Frame

WIDTH, HEIGHT = 66, 50


def write(ring: FrameRing, sequence: int) -> Frame:
    ring.slot(sequence)[:] = sequence % 251
    return Frame(sequence, ring.commit(sequence), 0, "test", WIDTH, HEIGHT, 1.0, 1.0)


def test_a_frame_is_read_as_it_was_written(tmp_path: Path) -> None:
    ring, reader = FrameRing(tmp_path, WIDTH, HEIGHT), FrameReader(tmp_path)
    for sequence in range(1, 20):
        image = reader.read(write(ring, sequence))
        assert image is not None
        assert image.shape == (HEIGHT, WIDTH)
        assert (image == sequence % 251).all()


def test_an_overwritten_frame_is_not_read(tmp_path: Path) -> None:
    ring, reader = FrameRing(tmp_path, WIDTH, HEIGHT), FrameReader(tmp_path)
    old = write(ring, 1)
    for sequence in range(2, SLOTS + 1):
        write(ring, sequence)
    assert reader.read(old) is not None
    ring.slot(1 + SLOTS)
    assert reader.read(old) is None


def test_the_copy_does_not_change_afterwards(tmp_path: Path) -> None:
    ring, reader = FrameRing(tmp_path, WIDTH, HEIGHT), FrameReader(tmp_path)
    image = reader.read(write(ring, 1))
    write(ring, 1 + SLOTS)
    assert image is not None
    assert np.all(image == 1)


def test_without_a_writer_or_with_other_dimensions_there_is_nothing(tmp_path: Path) -> None:
    reader = FrameReader(tmp_path)
    note = Frame(1, 1, 0, "test", WIDTH, HEIGHT, 1.0, 1.0)
    assert reader.read(note) is None
    write(FrameRing(tmp_path, WIDTH, HEIGHT), 1)
    assert reader.read(Frame(1, 1, 0, "test", 2 * WIDTH, HEIGHT, 1.0, 1.0)) is None
    assert reader.read(note) is not None


def test_a_restarted_writer_is_followed(tmp_path: Path) -> None:
    reader = FrameReader(tmp_path)
    assert reader.read(write(FrameRing(tmp_path, WIDTH, HEIGHT), 1)) is not None
    image = reader.read(write(FrameRing(tmp_path, WIDTH, HEIGHT), 2))
    assert image is not None
    assert (image == 2).all()


def test_a_full_runtime_directory_is_named_before_a_frame_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int, _offset: int, _length: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(DeviceError, match=r"frames\.ring: no room for .* MB of frames: No space left"):
        FrameRing(tmp_path, WIDTH, HEIGHT)
    assert list(tmp_path.iterdir()) == []


def test_the_memory_is_there_from_the_start(tmp_path: Path) -> None:
    FrameRing(tmp_path, WIDTH, HEIGHT)
    file = (tmp_path / "frames.ring").stat()
    assert file.st_blocks * 512 >= file.st_size
