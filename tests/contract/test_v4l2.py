"""The V4L2 driver: stamps, formats, refused settings, and errors inside OpenCV."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import Config
from common.errors import DeviceError
from follower.camera.v4l2 import V4l2Source
from tests.contract.camera_rigs import (
    EXPOSURE_US,
    NOW_NS,
    context,
    grab,
    picture,
)
from tests.contract.fake_cameras import FakeVideo, FakeYuyv


def test_v4l2_takes_the_drivers_stamp_only_if_it_is_of_this_clock(config: Config, tmp_path: Path) -> None:
    half_ns = round(500 * EXPOSURE_US)
    stamps = [(4990.0, 4_990_000_000), *((other, NOW_NS) for other in (0.0, 9e9, math.nan, math.inf, -math.inf))]
    for stamp_ms, expected_ns in stamps:
        video = FakeVideo(picture(), stamp_ms)
        source = V4l2Source(context(config, tmp_path, "v4l2"), lambda device, v=video: v)  # type: ignore[misc]  # noqa: ARG005
        source.open()
        capture = grab(source)[1]
        assert capture is not None
        assert capture.capture_ns == expected_ns - half_ns


def test_v4l2_turns_colour_to_grey_and_refuses_other_types(config: Config, tmp_path: Path) -> None:
    colour = FakeVideo(cv2.cvtColor(picture(), cv2.COLOR_GRAY2BGR))
    source = V4l2Source(context(config, tmp_path, "v4l2"), lambda device: colour)  # noqa: ARG005
    source.open()
    assert np.array_equal(grab(source)[0], picture())
    colour.image = picture().astype(np.uint16)
    with pytest.raises(DeviceError, match="in grey"):
        grab(source)


def test_v4l2_takes_a_camera_that_knows_yuyv_only(config: Config, tmp_path: Path) -> None:
    video = FakeYuyv(picture())
    source = V4l2Source(context(config, tmp_path, "v4l2"), lambda device: video)  # noqa: ARG005
    source.open()
    assert np.array_equal(grab(source)[0], picture())


def test_v4l2_names_what_is_refused_and_reports_what_is_in_force(
    config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    refused = {cv2.CAP_PROP_EXPOSURE: 15.6, cv2.CAP_PROP_GAIN: -1.0, cv2.CAP_PROP_FPS: 30.0}
    video = FakeVideo(picture(), stamp_ms=4990.0, refused=refused)
    source = V4l2Source(context(config, tmp_path, "v4l2", "/dev/video9"), lambda device: video)  # noqa: ARG005
    source.open()
    said = [record.getMessage() for record in caplog.records]
    assert "/dev/video9: camera.exposure_us = 800 refused, 1560 is in force" in said
    assert "/dev/video9: camera.rate_hz = 60 refused, 30 is in force" in said
    assert "/dev/video9: camera.gain = 2 refused, the value in force is not reported" in said
    capture = grab(source)[1]
    assert capture is not None
    assert (capture.exposure_us, capture.gain) == (1560.0, 2.0)
    assert capture.capture_ns == 4_990_000_000 - 780_000, "half of the exposure that is in force"


def test_v4l2_says_nothing_when_all_is_taken(
    config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    V4l2Source(context(config, tmp_path, "v4l2"), lambda device: FakeVideo(picture())).open()  # noqa: ARG005
    assert not caplog.records


def test_v4l2_an_error_inside_opencv_is_a_lost_device(config: Config, tmp_path: Path) -> None:
    video = FakeVideo(picture())
    source = V4l2Source(context(config, tmp_path, "v4l2"), lambda device: video)  # noqa: ARG005
    source.open()
    video.raising = True
    with pytest.raises(DeviceError, match="/dev/video0: lost: ") as lost:
        grab(source)
    assert "\n" not in str(lost.value)


def test_v4l2_missing_or_of_another_size(config: Config, tmp_path: Path) -> None:
    made = context(config, tmp_path, "v4l2", "/dev/video9")
    missing = V4l2Source(made, lambda device: FakeVideo(picture(), plugged=False))  # noqa: ARG005
    with pytest.raises(DeviceError, match="/dev/video9: cannot be opened"):
        missing.open()
    small = V4l2Source(made, lambda device: FakeVideo(picture()[:48]))  # noqa: ARG005
    with pytest.raises(DeviceError, match="/dev/video9: gives 128×48"):
        small.open()
