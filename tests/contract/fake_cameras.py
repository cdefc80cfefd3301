"""Stand-ins for what the camera drivers call: the functions of the vendor's SDK module, and OpenCV's VideoCapture.

The SDK's fake keeps to its calling convention (handles, status codes, raised timeouts, a raw buffer that must be
given back) and counts what is open; it knows nothing of bandwidth, triggers or image processing.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import cv2
import numpy as np

from common.frames.ring import Image


class CameraException(Exception):  # noqa: N818 - the SDK's name
    """What the SDK's functions raise."""

    def __init__(self, error_code: int, message: str = "failed") -> None:
        super().__init__(message)
        self.error_code = error_code
        self.message = message


@dataclass
class FakeSdk:
    """State behind the module: cameras plugged in, images to come, settings made, buffers out."""

    image: Image
    serials: list[str] = field(default_factory=lambda: ["0123"])
    settings: dict[str, Any] = field(default_factory=dict)
    refused: str = ""
    lost: bool = False
    pending: int = 1_000
    open_handles: int = 0
    raw_out: int = 0
    buffers: dict[int, Any] = field(default_factory=dict)
    sensor: tuple[int, int] = (1280, 1024)
    overflows: int = 0

    def module(self) -> ModuleType:
        """The module ``mvsdk`` as the driver imports it."""
        module: Any = ModuleType("mvsdk")
        module.CameraException = CameraException
        module.CAMERA_STATUS_TIME_OUT, module.CAMERA_MEDIA_TYPE_MONO8 = -12, 0x01080001
        for name in ("SetIspOutFormat", "SetTriggerMode", "SetAeState", "SetExposureTime", "SetAnalogGainX"):
            setattr(module, f"Camera{name}", self._setter(name))
        module.CameraSetFrameRate, module.CameraPlay = self._setter("SetFrameRate"), self._play
        module.CameraGetImageResolution = lambda handle: _Resolution(*self.sensor)  # noqa: ARG005
        module.CameraSetImageResolution = self._setter("SetImageResolution")
        module.CameraEnumerateDevice = lambda: [] if self.lost else [_Device(serial) for serial in self.serials]
        module.CameraInit, module.CameraUnInit = self._init, self._uninit
        module.CameraAlignMalloc, module.CameraAlignFree = self._allocate, self.buffers.pop
        module.CameraGetImageBuffer = self._get
        module.CameraImageProcess, module.CameraReleaseImageBuffer = self._process, self._release
        return module  # type: ignore[no-any-return]

    def _setter(self, name: str) -> Any:
        def set_value(handle: int, value: Any) -> int:  # noqa: ARG001 - the SDK's signature
            self.settings[name] = value
            return -4 if name == self.refused else 0

        return set_value

    def _init(self, device: Any, load_mode: int, team: int) -> int:  # noqa: ARG002
        self.open_handles += 1
        return 7

    def _play(self, handle: int) -> int:  # noqa: ARG002
        return 0

    def _uninit(self, handle: int) -> int:  # noqa: ARG002
        self.open_handles -= 1
        return 0

    def _allocate(self, size: int, alignment: int) -> int:  # noqa: ARG002
        memory = ctypes.create_string_buffer(size)
        address = ctypes.addressof(memory)
        self.buffers[address] = memory
        return address

    def _get(self, handle: int, timeout_ms: int) -> tuple[int, Any]:  # noqa: ARG002
        if self.lost:
            raise CameraException(-38, "device lost")
        if self.pending == 0:
            raise CameraException(-12, "timeout")
        self.pending -= 1
        self.raw_out += 1
        return 1, _Head(*self.image.shape)

    def _process(self, handle: int, raw: int, buffer: int, head: Any) -> int:  # noqa: ARG002
        if self.image.size > len(self.buffers[buffer]):
            self.overflows += 1
            return 0
        ctypes.memmove(buffer, self.image.tobytes(), self.image.size)
        return 0

    def _release(self, handle: int, raw: int) -> int:  # noqa: ARG002
        self.raw_out -= 1
        return 0


@dataclass
class _Device:
    serial: str

    def GetSn(self) -> str:  # noqa: N802
        return self.serial


class _Resolution:
    """``tSdkImageResolution``: what the driver uses of it."""

    def __init__(self, width: int, height: int) -> None:
        self.iIndex, self.iHOffsetFOV, self.iVOffsetFOV = 0, 0, 0
        self.iWidthFOV, self.iHeightFOV, self.iWidth, self.iHeight = width, height, width, height


class _Head:
    def __init__(self, height: int, width: int) -> None:
        self.iHeight, self.iWidth, self.uBytes = height, width, height * width


class FakeVideo:
    """``cv2.VideoCapture`` of a UVC camera; ``refused`` are properties it does not take, ``raising`` breaks it."""

    def __init__(
        self, image: Any, stamp_ms: float = 0.0, plugged: bool = True, refused: dict[int, float] | None = None
    ) -> None:
        self.image = image
        self.plugged = plugged
        self.released = False
        self.raising = False
        self.refused = refused or {}
        self.properties: dict[int, float] = {cv2.CAP_PROP_POS_MSEC: stamp_ms, cv2.CAP_PROP_CONVERT_RGB: 1.0}

    def isOpened(self) -> bool:  # noqa: N802
        return self.plugged

    def set(self, prop: int, value: float) -> bool:
        if prop in self.refused:
            return False
        self.properties[prop] = value
        return True

    def get(self, prop: int) -> float:
        height, width = np.shape(self.image)[:2]
        sizes = {cv2.CAP_PROP_FRAME_WIDTH: float(width), cv2.CAP_PROP_FRAME_HEIGHT: float(height)}
        return sizes.get(prop, self.refused.get(prop, self.properties.get(prop, 0.0)))

    def read(self) -> tuple[bool, Any]:
        if self.raising:
            cv2.resize(np.zeros((0, 0), np.uint8), (1, 1))  # raises cv2.error
        return (True, self.image) if self.plugged else (False, None)

    def release(self) -> None:
        self.released = True


class FakeYuyv(FakeVideo):
    """A camera that knows YUYV only: two raw channels unless OpenCV converts to BGR."""

    def __init__(self, grey: Image) -> None:
        super().__init__(grey, refused={})

    def set(self, prop: int, value: float) -> bool:
        if prop == cv2.CAP_PROP_FOURCC and value != cv2.VideoWriter.fourcc(*"YUYV"):
            return False
        return super().set(prop, value)

    def read(self) -> tuple[bool, Any]:
        if self.properties[cv2.CAP_PROP_CONVERT_RGB]:
            return True, cv2.cvtColor(self.image, cv2.COLOR_GRAY2BGR)
        return True, np.dstack([self.image, np.full_like(self.image, 128)])
