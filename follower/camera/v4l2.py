"""UVC and other Video4Linux cameras through OpenCV."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import cv2
import numpy as np

from common.channels import Channel
from common.frame_ring import Image
from common.frame_source import Capture
from common.node import DeviceError, Inbox, NodeContext, Trigger
from common.timing import NS_PER_MS, NS_PER_S

_MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL
_EXPOSURE_UNIT_US = 100.0  # of V4L2_CID_EXPOSURE_ABSOLUTE
_TIMEOUT_MS = 500.0
_DEFAULT_DEVICE = "/dev/video0"


class VideoDevice(Protocol):
    """What is used of ``cv2.VideoCapture``."""

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Whether the device could be opened."""

    def set(self, prop: int, value: float) -> bool:
        """Set a property; False if it is not supported."""

    def get(self, prop: int) -> float:
        """A property's value."""

    def read(self) -> tuple[bool, Any]:
        """Wait for the next image."""

    def release(self) -> None:
        """Close the device."""


def _opened(device: str) -> VideoDevice:
    return cv2.VideoCapture(device, cv2.CAP_V4L2)


class V4l2Source:
    """A camera at ``/dev/video…``: grey, uncompressed if it can, exposure and gain set by hand.

    ``capture_ns`` is the driver's own monotonic stamp less half the exposure, receipt where it gives none.
    """

    trigger = Trigger(free=True)
    inputs: tuple[Channel[Any], ...] = ()

    def __init__(self, context: NodeContext, opened: Callable[[str], VideoDevice] = _opened) -> None:
        self._camera = context.config.camera
        self._clock = context.clock
        self._opened = opened
        self._device = self._camera.device or _DEFAULT_DEVICE
        self._video: VideoDevice | None = None

    def open(self) -> None:
        """Open the device and set format, rate, exposure and gain.

        Raises:
            DeviceError: it is not there or has not the configured image size.
        """
        self.close()
        camera, video = self._camera, self._opened(self._device)
        self._video = video
        if not video.isOpened():
            self.close()
            raise DeviceError(
                f"{self._device}: cannot be opened: not plugged in, or in use (see v4l2-ctl --list-devices)"
            )
        wanted = (
            (cv2.CAP_PROP_FOURCC, float(cv2.VideoWriter.fourcc(*"GREY"))),
            (cv2.CAP_PROP_CONVERT_RGB, 0.0),
            (cv2.CAP_PROP_FRAME_WIDTH, float(camera.width_px)),
            (cv2.CAP_PROP_FRAME_HEIGHT, float(camera.height_px)),
            (cv2.CAP_PROP_FPS, camera.rate_hz),
            (cv2.CAP_PROP_BUFFERSIZE, 2.0),
            (cv2.CAP_PROP_READ_TIMEOUT_MSEC, _TIMEOUT_MS),
            (cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE),
            (cv2.CAP_PROP_EXPOSURE, camera.exposure_us / _EXPOSURE_UNIT_US),
            (cv2.CAP_PROP_GAIN, camera.gain),
        )
        for prop, value in wanted:
            video.set(prop, value)
        size = (round(video.get(cv2.CAP_PROP_FRAME_WIDTH)), round(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        if size != (camera.width_px, camera.height_px):
            self.close()
            raise DeviceError(
                f"{self._device}: gives {size[0]}×{size[1]}, camera.width_px and height_px say "
                f"{camera.width_px}×{camera.height_px}"
            )

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002 - it waits for light
        """Wait for the next image."""
        if self._video is None:
            raise DeviceError(f"{self._device}: is not open")
        done, pixels = self._video.read()
        arrived_ns = self._clock.now_ns()
        if not done or pixels is None:
            raise DeviceError(f"{self._device}: gives no images any more: unplugged?")
        grey = _grey(np.asarray(pixels), image.shape)
        if grey is None:
            raise DeviceError(f"{self._device}: image of shape {np.shape(pixels)}, expected {image.shape} in grey")
        np.copyto(image, grey)
        exposure_us = self._camera.exposure_us
        taken_ns = self._stamp_ns(arrived_ns) - round(500.0 * exposure_us)
        return Capture(max(taken_ns, 0), exposure_us, self._camera.gain, f"v4l2:{self._device}")

    def close(self) -> None:
        """Close the device."""
        video, self._video = self._video, None
        if video is not None:
            video.release()

    def _stamp_ns(self, arrived_ns: int) -> int:
        """The driver's stamp if it is of this clock, that is, of the last second."""
        if self._video is None:
            return arrived_ns
        stamp_ns = round(self._video.get(cv2.CAP_PROP_POS_MSEC) * NS_PER_MS)
        return stamp_ns if 0 <= arrived_ns - stamp_ns < NS_PER_S else arrived_ns


def _grey(pixels: Any, shape: tuple[int, ...]) -> Image | None:
    """The image as (height, width) uint8; None if it is of another size or type."""
    if pixels.dtype != np.uint8:
        return None
    if pixels.ndim == 3 and pixels.shape[2] == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    elif pixels.size == shape[0] * shape[1]:
        pixels = pixels.reshape(shape)
    return pixels if pixels.shape == shape else None
