"""What every camera driver must do: open, fill the image in place, say what is wrong, survive unplug and re-plug."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

from common.config import CameraConfig, Config
from common.errors import DeviceError
from common.frame_ring import Image
from common.frame_source import Capture, FrameSource, frame_source
from common.node import Inbox, NodeContext
from common.timing import NS_PER_S, SteppedClock
from follower.camera.mindvision import MindVisionSource
from follower.camera.replay import ReplaySource, read_grey
from follower.camera.v4l2 import V4l2Source
from tests.contract.fake_cameras import FakeSdk, FakeVideo, FakeYuyv

WIDTH, HEIGHT = 128, 96
NOW_NS = 5 * NS_PER_S
EXPOSURE_US = 800.0


def picture() -> Image:
    return np.arange(WIDTH * HEIGHT, dtype=np.uint32).astype(np.uint8).reshape(HEIGHT, WIDTH)


def context(config: Config, tmp_path: Path, driver: str, device: str = "") -> NodeContext:
    camera = CameraConfig.model_validate(
        {
            **config.camera.model_dump(),
            "driver": driver,
            "device": device,
            "width_px": WIDTH,
            "height_px": HEIGHT,
            "exposure_us": EXPOSURE_US,
            "gain": 2.0,
        }
    )
    return NodeContext(
        config.model_copy(update={"camera": camera}), tmp_path / "robots.toml", tmp_path, 1, SteppedClock(NOW_NS)
    )


def inbox() -> Inbox:
    return Inbox("boot")


@dataclass
class Rig:
    """A driver and how to pull its plug and put it back."""

    source: FrameSource
    unplug: Callable[[], None]
    replug: Callable[[], None]


def mindvision_rig(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    return Rig(source, lambda: setattr(sdk, "lost", True), lambda: setattr(sdk, "lost", False))


def v4l2_rig(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:  # noqa: ARG001
    videos = [FakeVideo(picture(), stamp_ms=4990.0)]
    source = V4l2Source(context(config, tmp_path, "v4l2"), lambda device: videos[-1])  # noqa: ARG005
    return Rig(source, lambda: setattr(videos[-1], "plugged", False), lambda: videos.append(FakeVideo(picture())))


def replay_rig(config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:  # noqa: ARG001
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), picture())
    source = ReplaySource(context(config, tmp_path, "replay", str(folder)))

    def unplug() -> None:
        (folder / "1.png").write_bytes(b"not an image")

    return Rig(source, unplug, lambda: None)


RIGS = [mindvision_rig, v4l2_rig, replay_rig]


@pytest.fixture(params=RIGS, ids=lambda make: make.__name__.removesuffix("_rig"))
def rig(request: pytest.FixtureRequest, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    made: Rig = request.param(config, tmp_path, monkeypatch)
    return made


def grab(source: FrameSource, now_ns: int = NOW_NS) -> tuple[Image, Capture | None]:
    image: Image = np.zeros((HEIGHT, WIDTH), np.uint8)
    return image, source.grab(now_ns, inbox(), image)


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


def test_another_exposure_is_told_with_each_image_until_opened_anew(rig: Rig) -> None:
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


def test_mindvision_settings_come_from_the_configuration(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    source.open()
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


def test_an_exposure_that_the_camera_refuses_is_logged_and_not_told(
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


def test_mindvision_sets_the_resolution_in_the_middle_of_the_sensor(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    MindVisionSource(context(config, tmp_path, "mindvision")).open()
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
    with pytest.raises(DeviceError, match=rf"image of {shape[1]}×{shape[0]}, .* say {WIDTH}×{HEIGHT}"):
        grab(source)
    assert (sdk.overflows, sdk.raw_out) == (0, 0)


def test_mindvision_that_stays_silent_is_lost(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sdk = FakeSdk(picture())
    monkeypatch.setitem(sys.modules, "mvsdk", sdk.module())
    source = MindVisionSource(context(config, tmp_path, "mindvision"))
    source.open()
    sdk.pending = 0
    patient = [grab(source)[1] for _ in range(30)]
    assert patient == [None] * 30
    with pytest.raises(DeviceError, match="lost: timeout"):
        grab(source)
    source.close()
    source.open()
    assert grab(source)[1] is None, "opened anew, it has its second again"


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
    assert "/dev/video9: camera.gain = 2 refused, what is in force is not told" in said
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


def test_replay_keeps_its_rate_and_ends(config: Config, tmp_path: Path) -> None:
    source = replay_rig(config, tmp_path, pytest.MonkeyPatch()).source
    source.open()
    period_ns = source.trigger.period_ns
    assert grab(source, NOW_NS)[1] is not None
    assert grab(source, NOW_NS + 1)[1] is None
    later = grab(source, NOW_NS + period_ns + 5)[1]
    assert later is not None
    assert later.capture_ns == NOW_NS + period_ns
    assert grab(source, NOW_NS + 2 * period_ns)[1] is not None
    assert grab(source, NOW_NS + 9 * period_ns)[1] is None


def test_an_image_larger_than_opencv_takes_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.pgm"
    path.write_bytes(b"P5\n200000 200000\n255\n")
    assert read_grey(path) is None
    cv2.imwrite(str(path), picture())
    assert np.array_equal(np.asarray(read_grey(path)), picture())


def test_replay_counts_numbers_and_goes_on_after_a_broken_image(config: Config, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for number in (1, 2, 9, 10, 11):
        cv2.imwrite(str(folder / f"frame{number}.png"), np.full((HEIGHT, WIDTH), number, np.uint8))
    (folder / "frame9.png").write_bytes(b"not an image")
    source = ReplaySource(context(config, tmp_path, "replay", str(folder)))
    seen, now_ns = [], NOW_NS
    for _ in range(8):
        source.open()
        try:
            while (shot := grab(source, now_ns := now_ns + NS_PER_S))[1] is not None:
                seen.append(int(shot[0][0, 0]))
        except DeviceError as error:
            assert "frame9.png" in str(error)  # noqa: PT017 - which it was is the point
        source.close()
    assert seen == [1, 2, 10, 11], "in order, none twice, the broken one left out"


def test_replay_plays_a_video(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 60.0, (WIDTH, HEIGHT))
    bright = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    for _ in range(3):
        writer.write(bright)
    writer.release()
    source = ReplaySource(context(config, tmp_path, "replay", str(path)))
    source.open()
    image, capture = grab(source)
    assert capture is not None
    assert abs(float(image.mean()) - 200.0) < 5.0


@pytest.mark.parametrize("device", ["", "nowhere", "empty"])
def test_replay_without_images_says_where_it_looked(config: Config, tmp_path: Path, device: str) -> None:
    (tmp_path / "empty").mkdir()
    source = ReplaySource(context(config, tmp_path, "replay", str(tmp_path / device) if device else ""))
    with pytest.raises(DeviceError, match=device or "camera.device"):
        source.open()
