"""The MindVision driver against a fake of its SDK."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from common.config import Config
from common.errors import DeviceError
from follower.camera.mindvision import MindVisionSource
from tests.contract.camera_rigs import (
    EXPOSURE_US,
    HEIGHT,
    WIDTH,
    context,
    grab,
    picture,
)
from tests.contract.fake_cameras import FakeSdk


def opened(config: Config, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[FakeSdk, MindVisionSource]:
    """A camera that is there, and the source that has opened it."""
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, folder, "mindvision"))
    source.open()
    return sdk, source


def test_mindvision_settings_come_from_the_configuration(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk, source = opened(config, tmp_path, monkeypatch)
    assert sdk.settings["SetExposureTime"] == EXPOSURE_US
    assert sdk.settings["SetAnalogGainX"] == 2.0
    assert sdk.settings["SetFrameRate"] == 60
    assert sdk.settings["SetAeState"] == sdk.settings["SetTriggerMode"] == 0
    grab(source)
    assert sdk.raw_out == 0, "every raw buffer is given back"
    sdk.pending = 0
    assert grab(source)[1] is None, "a frame that is late is no fault"
    source.close()
    assert (sdk.open_handles, sdk.buffers) == (0, {})


@pytest.mark.parametrize(
    ("change", "device", "message"),
    [
        ({"serials": []}, "", "no MindVision camera found"),
        ({"serials": ["A", "B"]}, "", "several MindVision cameras, name one: A, B"),
        ({"serials": ["A"]}, "Z", "no MindVision camera 'Z'; there are: A"),
        ({"refused": "SetExposureTime"}, "", "camera.exposure_us refused"),
    ],
)
def test_mindvision_faults_are_one_clear_line(
    config: Config,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: dict[str, Any],
    device: str,
    message: str,
) -> None:
    sdk = FakeSdk(picture(), **change)
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    with pytest.raises(DeviceError, match=message):
        MindVisionSource(context(config, tmp_path, "mindvision", device)).open()
    assert (sdk.open_handles, sdk.buffers) == (0, {})


def test_mindvision_sets_the_resolution_in_the_middle_of_the_sensor(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk, _ = opened(config, tmp_path, monkeypatch)
    asked = sdk.settings["SetImageResolution"]
    assert (asked.iIndex, asked.iWidth, asked.iHeight) == (0xFF, WIDTH, HEIGHT)
    assert (asked.iHOffsetFOV, asked.iVOffsetFOV) == ((1280 - WIDTH) // 2, (1024 - HEIGHT) // 2)


@pytest.mark.parametrize("shape", [(1024, 1280), (HEIGHT, WIDTH + 8), (HEIGHT // 2, WIDTH)])
def test_mindvision_never_lets_the_sdk_write_past_its_buffer(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: tuple[int, int]
) -> None:
    sdk = FakeSdk(np.zeros(shape, np.uint8))
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    source.open()
    with pytest.raises(DeviceError, match=rf"image of {shape[1]}×{shape[0]}, .* are {WIDTH}×{HEIGHT}"):
        grab(source)
    assert (sdk.overflows, sdk.raw_out) == (0, 0)


def test_mindvision_that_stays_silent_is_lost(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk, source = opened(config, tmp_path, monkeypatch)
    sdk.pending = 0
    patient = [grab(source)[1] for _ in range(30)]
    assert patient == [None] * 30
    with pytest.raises(DeviceError, match="lost: timeout"):
        grab(source)
    source.close()
    source.open()
    assert grab(source)[1] is None, "opened again, it has its second again"


def test_without_the_sdk_the_message_says_what_to_install(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mvsdk", None)
    with pytest.raises(DeviceError, match=r"needs the vendor's SDK: .*mvsdk\.py"):
        MindVisionSource(context(config, tmp_path, "mindvision")).open()


def test_an_sdk_without_frame_rates_still_opens(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module: ModuleType = FakeSdk(picture()).module()
    del module.CameraSetFrameRate
    monkeypatch.setitem(sys.modules, "mvsdk", module)
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    source.open()
    assert grab(source)[1] is not None
