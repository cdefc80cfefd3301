"""The replay driver: its rate, its order, and files that cannot be read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import Config
from common.errors import DeviceError
from common.timing import NS_PER_S
from follower.camera.image_file import read_grey
from follower.camera.replay import ReplaySource
from tests.contract.camera_rigs import (
    HEIGHT,
    NOW_NS,
    WIDTH,
    context,
    grab,
    picture,
    replay_rig,
)


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
