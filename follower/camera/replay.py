"""A folder of images or a video file in place of a camera, at the configured rate."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.channels import Channel
from common.errors import DeviceError
from common.frames.ring import Image
from common.frames.source import Capture
from common.node import Inbox, NodeContext, Trigger
from common.timing import NS_PER_S
from follower.camera.image_file import IMAGE_SUFFIXES, depth_of, images_in, read_grey

_log = logging.getLogger("follower-camera")


class ReplaySource:
    """Frame k at k periods after the first grab; after the last there are no more frames.

    Numbers in file names count as numbers. An image that cannot be read is a lost camera; opened again, it goes on
    with the next.
    """

    inputs: tuple[Channel[Any], ...] = ()

    def __init__(self, context: NodeContext) -> None:
        self._camera = context.config.camera
        self._path = Path(self._camera.device)
        self._period_ns = round(NS_PER_S / self._camera.rate_hz)
        self.trigger = Trigger(period_ns=self._period_ns)
        self._files: list[Path] = []
        self._taken = 0
        self._full_scale = 65535
        self._video: cv2.VideoCapture | None = None
        self._due_ns: int | None = None

    def open(self) -> None:
        """Find the images.

        Raises:
            DeviceError: there is no such folder or file, or no image in it.
        """
        self.close()
        if not self._camera.device:
            raise DeviceError("camera.device: name a folder of images or a video file to replay")
        if self._path.is_dir():
            images = images_in(self._path)
            self._files = sorted(images, key=_by_number)[self._taken :]
            if not images:
                raise DeviceError(f"{self._path}: no images ({', '.join(IMAGE_SUFFIXES)}) in this folder")
            self._full_scale = self._scale()
            return
        video = cv2.VideoCapture(str(self._path)) if self._path.is_file() else None
        if video is None or not video.isOpened():
            raise DeviceError(f"{self._path}: neither a folder of images nor a video that OpenCV can read")
        self._video = video

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002 - files only
        """The next image once its time has come.

        Args:
            now_ns: the time; image k is due k periods after the first grab.
            inputs: not used.
            image: (height, width) uint8, written in place.
        """
        if self._due_ns is None:
            self._due_ns = now_ns
        if now_ns < self._due_ns:
            return None
        pixels = self._next()
        if pixels is None:
            return None
        origin, grey = pixels
        if grey.shape != image.shape:
            raise DeviceError(
                f"{origin}: image of {grey.shape[1]}×{grey.shape[0]}, camera.width_px and height_px are "
                f"{image.shape[1]}×{image.shape[0]}"
            )
        np.copyto(image, grey)
        capture_ns, self._due_ns = self._due_ns, self._due_ns + self._period_ns
        return Capture(capture_ns, self._camera.exposure_us, self._camera.gain, f"replay:{self._path.name}")

    def expose(self, exposure_us: float) -> None:
        """Recorded images are as they are."""
        _log.warning("%s: recorded, cannot be exposed for %g µs", self._path, exposure_us)

    def close(self) -> None:
        """Release the files; reopened, a video starts again, a folder continues."""
        if self._video is not None:
            self._video.release()
        self._video = None
        self._files = []
        self._due_ns = None

    def _next(self) -> tuple[Path, Image] | None:
        """The next image in grey; None at the end."""
        if self._video is not None:
            done, frame = self._video.read()
            return (self._path, np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.uint8)) if done else None
        if not self._files:
            return None
        path = self._files.pop(0)
        self._taken += 1
        grey = read_grey(path, self._full_scale)
        if grey is None:
            raise DeviceError(f"{path}: truncated, or not an image that OpenCV can read")
        return path, grey

    def _scale(self) -> int:
        """Full scale of files of 16 bits: sensors of 10 to 14 bits often leave the upper ones empty."""
        bits = depth_of(self._files)
        if 8 < bits < 16:
            _log.warning("%s: the images of 16 bits use %d of them; scaled as %d bits", self._path, bits, bits)
        return (1 << max(bits, 8)) - 1 if bits > 8 else 65535


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Order of file names in which 2 comes before 10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)]
