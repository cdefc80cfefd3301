"""Shared memory for frames: a ring of slots in a file of the runtime directory, which lies on tmpfs.

One writer, any number of readers. Each slot begins with its frame's sequence number; a reader copies the slot and
then checks that the number has not changed. The ring lives in the runtime directory, so a killed process leaves no
memory behind.
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import DeviceError
from common.messages import Frame

Image = NDArray[np.uint8]
SLOTS = 6
_HEAD = 64
_NAME = "frames.ring"


class FrameRing:
    """Writer's side; made by the camera process.

    Raises:
        DeviceError: the runtime directory has no room for the frames.
    """

    def __init__(self, runtime: Path, width_px: int, height_px: int) -> None:
        self._stride = _slot_bytes(width_px, height_px)
        path = runtime / _NAME
        path.unlink(missing_ok=True)  # readers of an earlier run keep the old file
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            # the memory itself, now: a sparse file on a full tmpfs would kill its writer by SIGBUS
            os.posix_fallocate(descriptor, 0, SLOTS * self._stride)
            self._memory = mmap.mmap(descriptor, SLOTS * self._stride)
        except OSError as error:
            path.unlink(missing_ok=True)
            megabytes = SLOTS * self._stride / 1e6
            raise DeviceError(f"{path}: no room for {megabytes:.0f} MB of frames: {error.strerror}") from error
        finally:
            os.close(descriptor)
        self._shape = (height_px, width_px)

    def slot(self, sequence: int) -> Image:
        """Begin frame ``sequence``; returns its pixels, (height, width), to be written in place."""
        offset = (sequence % SLOTS) * self._stride
        self._mark(offset, 0)
        height, width = self._shape
        return np.frombuffer(self._memory, np.uint8, height * width, offset + _HEAD).reshape(self._shape)

    def commit(self, sequence: int) -> int:
        """Mark frame ``sequence`` as complete; returns its slot."""
        slot = sequence % SLOTS
        self._mark(slot * self._stride, sequence)
        return slot

    def _mark(self, offset: int, sequence: int) -> None:
        self._memory[offset : offset + 8] = sequence.to_bytes(8, "little")


class FrameReader:
    """The reader's side: opens the file at the first frame, and again after a restart of the writer."""

    def __init__(self, runtime: Path) -> None:
        self._path = runtime / _NAME
        self._memory: mmap.mmap | None = None
        self._inode = -1

    def read(self, frame: Frame) -> Image | None:
        """A copy of the frame's pixels, (height, width); None if they are overwritten or missing."""
        stride = _slot_bytes(frame.width_px, frame.height_px)
        memory = self._open()
        if memory is None or frame.slot >= SLOTS or len(memory) != SLOTS * stride:
            return None
        offset = frame.slot * stride
        pixels = np.frombuffer(memory, np.uint8, frame.width_px * frame.height_px, offset + _HEAD).copy()
        if int.from_bytes(memory[offset : offset + 8], "little") != frame.sequence:
            return None
        return pixels.reshape(frame.height_px, frame.width_px)

    def _open(self) -> mmap.mmap | None:
        try:
            inode = self._path.stat().st_ino
            if self._memory is None or inode != self._inode:
                with self._path.open("rb") as file:
                    self._memory = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
                self._inode = inode
        except (OSError, ValueError):
            return None
        return self._memory


def _slot_bytes(width_px: int, height_px: int) -> int:
    return _HEAD + -(-width_px * height_px // 64) * 64
