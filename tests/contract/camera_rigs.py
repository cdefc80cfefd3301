"""Each camera driver with what pulls its plug, and one picture."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import CameraConfig, Config
from common.frames.ring import Image
from common.frames.source import Capture, FrameSource
from common.node import Inbox, NodeContext
from common.timing import NS_PER_S, SteppedClock
from follower.camera.mindvision import MindVisionSource
from follower.camera.replay import ReplaySource
from follower.camera.v4l2 import V4l2Source
from tests.contract.fake_cameras import FakeSdk, FakeVideo

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


def grab(source: FrameSource, now_ns: int = NOW_NS) -> tuple[Image, Capture | None]:
    image: Image = np.zeros((HEIGHT, WIDTH), np.uint8)
    return image, source.grab(now_ns, inbox(), image)
