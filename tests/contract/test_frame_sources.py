"""What every camera driver must do: open, fill the image in place, say what is wrong, survive unplug and re-plug."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from common.config import Config
from common.errors import DeviceError
from common.frames.ring import Image
from common.frames.source import frame_source
from common.timing import NS_PER_S
from follower.camera.mindvision import MindVisionSource
from follower.camera.replay import ReplaySource
from tests.contract.camera_rigs import (
    EXPOSURE_US,
    HEIGHT,
    NOW_NS,
    RIGS,
    WIDTH,
    Rig,
    context,
    grab,
    inbox,
    picture,
)
from tests.contract.fake_cameras import FakeSdk


@pytest.fixture(params=RIGS, ids=lambda make: make.__name__.removesuffix("_rig"))
def rig(request: pytest.FixtureRequest, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    made: Rig = request.param(config, tmp_path, monkeypatch)
    return made


def test_an_image_is_written_in_place_with_its_facts(rig: Rig) -> None:
    rig.source.open()
    image, capture = grab(rig.source)
    assert capture is not None
    assert np.array_equal(image, picture())
    assert (capture.exposure_us, capture.gain) == (EXPOSURE_US, 2.0)
    assert NOW_NS - NS_PER_S // 20 < capture.capture_ns <= NOW_NS
    assert capture.camera_id
    rig.source.close()


def test_unplugged_it_says_so_and_opens_again_when_it_is_back(rig: Rig) -> None:
    rig.source.open()
    assert grab(rig.source)[1] is not None
    rig.unplug()
    with pytest.raises(DeviceError) as lost:
        grab(rig.source, NOW_NS + NS_PER_S)
    assert "\n" not in str(lost.value)
    rig.source.close()
    rig.replug()
    rig.source.open()
    assert grab(rig.source, NOW_NS + 2 * NS_PER_S)[1] is not None


def test_each_image_carries_another_exposure_until_reopened(rig: Rig) -> None:
    rig.source.expose(4.0 * EXPOSURE_US)
    rig.source.open()
    rig.source.expose(4.0 * EXPOSURE_US)
    capture = grab(rig.source)[1]
    assert capture is not None
    recorded = isinstance(rig.source, ReplaySource)
    assert capture.exposure_us == (EXPOSURE_US if recorded else 4.0 * EXPOSURE_US)
    rig.source.close()
    rig.replug()
    rig.source.open()
    capture = grab(rig.source, NOW_NS + NS_PER_S)[1]
    assert capture is not None
    assert capture.exposure_us == EXPOSURE_US


def test_closing_is_harmless_at_any_time(rig: Rig) -> None:
    rig.source.close()
    rig.source.open()
    rig.source.close()
    rig.source.close()


def test_an_image_of_another_size_is_refused(rig: Rig) -> None:
    rig.source.open()
    other: Image = np.zeros((HEIGHT // 2, WIDTH), np.uint8)
    with pytest.raises(DeviceError, match=rf"{WIDTH}×{HEIGHT}|shape"):
        rig.source.grab(NOW_NS, inbox(), other)


@pytest.mark.parametrize("driver", ["mindvision", "v4l2", "replay", "sim"])
def test_every_driver_is_found_by_its_name(config: Config, tmp_path: Path, driver: str) -> None:
    source = frame_source(context(config, tmp_path, driver, "somewhere"))
    assert source.trigger.free or source.trigger.period_ns or source.trigger.wakes


def test_an_exposure_that_the_camera_refuses_is_logged_and_not_reported(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    source.open()
    sdk.refused = "SetExposureTime"
    source.expose(4.0 * EXPOSURE_US)
    assert "exposure of 3200 µs refused" in caplog.text
    capture = grab(source)[1]
    assert capture is not None
    assert capture.exposure_us == EXPOSURE_US
