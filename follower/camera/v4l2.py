"""UVC and other Video4Linux cameras through OpenCV."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any, Protocol

import cv2
import numpy as np

from common.channels import Channel
from common.errors import DeviceError
from common.frames.ring import Image
from common.frames.source import Capture
from common.node import Inbox, NodeContext, Trigger
from common.timing import NS_PER_MS, NS_PER_S

_MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL
_EXPOSURE_UNIT_US = 100.0  # of V4L2_CID_EXPOSURE_ABSOLUTE
_TIMEOUT_MS = 500.0
_DEFAULT_DEVICE = "/dev/video0"
_GREY, _YUYV = (float(cv2.VideoWriter.fourcc(*code)) for code in ("GREY", "YUYV"))
_SAME = 0.05  # relative difference up to which a setting counts as taken: drivers round
_log = logging.getLogger("follower-camera")


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
    """A camera at ``/dev/video…``: grey and uncompressed if it can, exposure and gain set by hand.

    A camera that has no grey format is taken in colour and turned to grey. What it does not take of rate, exposure
    and gain is named in a warning, and each image carries what is in force, as far as the driver reports it.
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
        self._exposure_us, self._gain = self._camera.exposure_us, self._camera.gain

    def open(self) -> None:
        """Open the device and set format, rate, exposure and gain.

        Raises:
            DeviceError: it is not there or has not the configured image size.
        """
        self.close()
        try:
            self._set_up(self._opened(self._device))
        except cv2.error as error:
            self.close()
            raise DeviceError(f"{self._device}: {_first_line(error)}") from error
        except DeviceError:
            self.close()
            raise

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002 - it waits for light
        """Wait for the next image.

        Args:
            now_ns: not used: the device paces the loop.
            inputs: not used.
            image: (height, width) uint8, written in place.
        """
        if self._video is None:
            raise DeviceError(f"{self._device}: is not open")
        try:
            done, pixels = self._video.read()
        except cv2.error as error:
            raise DeviceError(f"{self._device}: lost: {_first_line(error)}") from error
        arrived_ns = self._clock.now_ns()
        if not done or pixels is None:
            raise DeviceError(f"{self._device}: gives no images any more: unplugged?")
        grey = _grey(np.asarray(pixels), image.shape)
        if grey is None:
            raise DeviceError(f"{self._device}: image of shape {np.shape(pixels)}, expected {image.shape} in grey")
        np.copyto(image, grey)
        taken_ns = self._stamp_ns(arrived_ns) - round(500.0 * self._exposure_us)
        return Capture(max(taken_ns, 0), self._exposure_us, self._gain, f"v4l2:{self._device}")

    def expose(self, exposure_us: float) -> None:
        """As the driver takes it; a device that was closed meanwhile is set up with the configured one."""
        if self._video is not None:
            self._exposure_us = self._in_force(
                self._video, "exposure_us", cv2.CAP_PROP_EXPOSURE, exposure_us, _EXPOSURE_UNIT_US
            )

    def close(self) -> None:
        """Close the device."""
        video, self._video = self._video, None
        if video is not None:
            video.release()

    def _set_up(self, video: VideoDevice) -> None:
        self._video, camera = video, self._camera
        if not video.isOpened():
            raise DeviceError(
                f"{self._device}: cannot be opened: not plugged in, or in use (see v4l2-ctl --list-devices)"
            )
        _set_format(video, self._device)
        video.set(cv2.CAP_PROP_FRAME_WIDTH, float(camera.width_px))
        video.set(cv2.CAP_PROP_FRAME_HEIGHT, float(camera.height_px))
        size = (round(_reported(video, cv2.CAP_PROP_FRAME_WIDTH)), round(_reported(video, cv2.CAP_PROP_FRAME_HEIGHT)))
        if size != (camera.width_px, camera.height_px):
            raise DeviceError(
                f"{self._device}: gives {size[0]}×{size[1]}, camera.width_px and height_px are "
                f"{camera.width_px}×{camera.height_px}"
            )
        video.set(cv2.CAP_PROP_BUFFERSIZE, 2.0)
        video.set(cv2.CAP_PROP_READ_TIMEOUT_MSEC, _TIMEOUT_MS)
        if not video.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE):
            _log.warning("%s: does not take manual exposure: it may expose as it likes", self._device)
        self._in_force(video, "camera.rate_hz", cv2.CAP_PROP_FPS, camera.rate_hz, 1.0)
        self._exposure_us = self._in_force(
            video, "camera.exposure_us", cv2.CAP_PROP_EXPOSURE, camera.exposure_us, _EXPOSURE_UNIT_US
        )
        self._gain = self._in_force(video, "camera.gain", cv2.CAP_PROP_GAIN, camera.gain, 1.0)

    def _in_force(self, video: VideoDevice, key: str, prop: int, wanted: float, unit: float) -> float:
        """Set a property in the driver's unit; the value in force, the wanted one where the driver reports none."""
        taken = video.set(prop, wanted / unit)
        reported = _reported(video, prop) * unit
        if reported > 0.0 and abs(reported - wanted) > _SAME * wanted:
            _log.warning("%s: %s = %g refused, %g is in force", self._device, key, wanted, reported)
        elif not taken:
            _log.warning("%s: %s = %g refused, the value in force is not reported", self._device, key, wanted)
        return reported if reported > 0.0 else wanted

    def _stamp_ns(self, arrived_ns: int) -> int:
        """The driver's stamp if it is of this clock, that is, of the last second."""
        if self._video is None:
            return arrived_ns
        stamp_ns = round(_reported(self._video, cv2.CAP_PROP_POS_MSEC) * NS_PER_MS)
        return stamp_ns if 0 <= arrived_ns - stamp_ns < NS_PER_S else arrived_ns


def _set_format(video: VideoDevice, device: str) -> None:
    """Grey as the camera sends it, else colour that OpenCV converts."""
    if video.set(cv2.CAP_PROP_FOURCC, _GREY) and video.get(cv2.CAP_PROP_FOURCC) == _GREY:
        video.set(cv2.CAP_PROP_CONVERT_RGB, 0.0)
        return
    if not video.set(cv2.CAP_PROP_FOURCC, _YUYV):
        _log.warning("%s: neither GREY nor YUYV: its images may be compressed, which moves centroids", device)
    video.set(cv2.CAP_PROP_CONVERT_RGB, 1.0)


def _reported(video: VideoDevice, prop: int) -> float:
    """A property's value; 0 where the driver reports no number."""
    value = float(video.get(prop))
    return value if math.isfinite(value) else 0.0


def _first_line(error: cv2.error) -> str:
    return str(error).strip().partition("\n")[0]


def _grey(pixels: Any, shape: tuple[int, ...]) -> Image | None:
    """The image as (height, width) uint8; None if it is of another size or type."""
    if pixels.dtype != np.uint8:
        return None
    if pixels.ndim == 3 and pixels.shape[2] == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    elif pixels.size == shape[0] * shape[1]:
        pixels = pixels.reshape(shape)
    return pixels if pixels.shape == shape else None
