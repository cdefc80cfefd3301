"""MindVision cameras (MV-SUA133GM) through ``mvsdk.py``, the Python module that comes with the vendor's SDK.

The module is not on any package index: put ``mvsdk.py`` of the SDK's Python demo beside the interpreter's other
modules and install the SDK's library. It is loaded when this driver is opened, not before.
"""

from __future__ import annotations

import ctypes
import importlib
import logging
from types import ModuleType
from typing import Any

import numpy as np

from common.channels import Channel
from common.errors import DeviceError
from common.frames.ring import Image
from common.frames.source import Capture
from common.node import Inbox, NodeContext, Trigger
from common.timing import NS_PER_MS

_ALIGNMENT = 16
_READOUT_NS = 9 * NS_PER_MS  # 1280 × 1024 over USB 3
_CUSTOM_RESOLUTION = 0xFF  # tSdkImageResolution.iIndex
_SILENT_MS = 1000
_FEWEST_TIMEOUTS = 5
_log = logging.getLogger("follower-camera")


class MindVisionSource:
    """A global-shutter camera that streams by itself; exposure, gain and rate come from the configuration.

    ``capture_ns`` is receipt less the readout and half the exposure: the camera's own clock is not this robot's.
    """

    trigger = Trigger(free=True)
    inputs: tuple[Channel[Any], ...] = ()

    def __init__(self, context: NodeContext) -> None:
        self._camera = context.config.camera
        self._exposure_us = self._camera.exposure_us
        self._clock = context.clock
        self._wait_ms = max(2, round(2000.0 / self._camera.rate_hz))
        self._patience = max(_FEWEST_TIMEOUTS, -(-_SILENT_MS // self._wait_ms))
        self._timeouts = 0
        self._sdk: Any = None
        self._handle: int | None = None
        self._buffer = 0
        self._serial = ""

    def open(self) -> None:
        """Find the camera, set it up and start it.

        Raises:
            DeviceError: no SDK, no such camera, or it refuses a setting.
        """
        self._sdk = _load_sdk()
        try:
            self._start(self._find())
        except self._sdk.CameraException as error:
            self.close()
            raise DeviceError(f"MindVision camera {self._serial or '(any)'}: {_text(error)}") from error

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002 - it waits for light
        """Wait up to two frame periods for the next image; silence of a second is a lost camera.

        Args:
            now_ns: not used: the device paces the loop.
            inputs: not used.
            image: (height, width) uint8, written in place.
        """
        sdk = self._sdk
        if self._handle is None:
            raise DeviceError("MindVision camera is not open")
        try:
            raw, head = sdk.CameraGetImageBuffer(self._handle, self._wait_ms)
        except sdk.CameraException as error:
            self._timeouts += 1
            if error.error_code == sdk.CAMERA_STATUS_TIME_OUT and self._timeouts < self._patience:
                return None
            raise DeviceError(f"MindVision camera {self._serial}: lost: {_text(error)}") from error
        self._timeouts = 0
        arrived_ns = self._clock.now_ns()
        try:
            self._check_size(head, image)  # before the SDK writes so many pixels into the buffer
            sdk.CameraImageProcess(self._handle, raw, self._buffer, head)
        finally:
            sdk.CameraReleaseImageBuffer(self._handle, raw)
        pixels = (ctypes.c_ubyte * image.size).from_address(self._buffer)
        np.copyto(image, np.ctypeslib.as_array(pixels).reshape(image.shape))
        capture_ns = arrived_ns - _READOUT_NS - round(500.0 * self._exposure_us)
        return Capture(max(capture_ns, 0), self._exposure_us, self._camera.gain, f"mindvision:{self._serial}")

    def expose(self, exposure_us: float) -> None:
        """As the camera takes it."""
        if self._handle is None:
            return
        status = self._sdk.CameraSetExposureTime(self._handle, exposure_us)
        if status == 0:
            self._exposure_us = exposure_us
        else:
            _log.warning("MindVision camera %s: exposure of %g µs refused (%d)", self._serial, exposure_us, status)

    def close(self) -> None:
        """Stop the camera and free its buffer."""
        handle, self._handle = self._handle, None
        buffer, self._buffer = self._buffer, 0
        if handle is not None:
            self._sdk.CameraUnInit(handle)
        if buffer:
            self._sdk.CameraAlignFree(buffer)

    def _find(self) -> Any:
        found = {device.GetSn(): device for device in self._sdk.CameraEnumerateDevice()}
        wanted = self._camera.device
        if not found:
            raise DeviceError("no MindVision camera found: check the USB 3 cable and the SDK's udev rule")
        if wanted and wanted not in found:
            raise DeviceError(
                f"camera.device: no MindVision camera {wanted!r}; there are: {', '.join(sorted(found))}"
            )
        if not wanted and len(found) > 1:
            raise DeviceError(f"camera.device: several MindVision cameras, name one: {', '.join(sorted(found))}")
        self._serial = wanted or next(iter(found))
        return found[self._serial]

    def _start(self, device: Any) -> None:
        sdk, camera = self._sdk, self._camera
        handle = self._handle = sdk.CameraInit(device, -1, -1)
        self._set("mono output", sdk.CameraSetIspOutFormat(handle, sdk.CAMERA_MEDIA_TYPE_MONO8))
        self._set("camera.width_px, height_px", self._set_resolution())
        self._set("free running", sdk.CameraSetTriggerMode(handle, 0))
        self._set("manual exposure", sdk.CameraSetAeState(handle, 0))
        self._set("camera.exposure_us", sdk.CameraSetExposureTime(handle, camera.exposure_us))
        self._exposure_us = camera.exposure_us
        self._set("camera.gain", sdk.CameraSetAnalogGainX(handle, camera.gain))
        if hasattr(sdk, "CameraSetFrameRate"):
            self._set("camera.rate_hz", sdk.CameraSetFrameRate(handle, round(camera.rate_hz)))
        else:
            _log.warning("this mvsdk.py cannot set a frame rate: the camera runs at its own, not at camera.rate_hz")
        self._buffer = sdk.CameraAlignMalloc(camera.width_px * camera.height_px, _ALIGNMENT)
        self._timeouts = 0
        self._set("start", sdk.CameraPlay(handle))

    def _set_resolution(self) -> int:
        """Ask for the configured size, in the middle of what the camera shows now; the SDK's status."""
        wanted = self._sdk.CameraGetImageResolution(self._handle)
        width, height = self._camera.width_px, self._camera.height_px
        if (wanted.iWidth, wanted.iHeight) == (width, height):
            return 0
        wanted.iHOffsetFOV += max(wanted.iWidthFOV - width, 0) // 2
        wanted.iVOffsetFOV += max(wanted.iHeightFOV - height, 0) // 2
        wanted.iIndex = _CUSTOM_RESOLUTION
        wanted.iWidthFOV = wanted.iWidth = width
        wanted.iHeightFOV = wanted.iHeight = height
        return int(self._sdk.CameraSetImageResolution(self._handle, wanted))

    def _check_size(self, head: Any, image: Image) -> None:
        expected = (self._camera.height_px, self._camera.width_px)
        if not (head.iHeight, head.iWidth) == expected == image.shape:
            raise DeviceError(
                f"MindVision camera {self._serial}: image of {head.iWidth}×{head.iHeight}, "
                f"camera.width_px and height_px are {image.shape[1]}×{image.shape[0]}"
            )

    def _set(self, what: str, status: int) -> None:
        if status != 0:
            self.close()
            raise DeviceError(f"MindVision camera {self._serial}: {what} refused (status {status})")


def _load_sdk() -> ModuleType:
    try:
        return importlib.import_module("mvsdk")
    except (ImportError, OSError) as error:
        raise DeviceError(
            "camera.driver 'mindvision' needs the vendor's SDK: install its library and put mvsdk.py of its "
            f"Python demo on the path ({error})"
        ) from error


def _text(error: Any) -> str:
    return f"{error.message} (status {error.error_code})"
