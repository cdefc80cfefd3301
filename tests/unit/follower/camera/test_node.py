"""The camera process: frames numbered and announced, a lost camera opened again, none of it by an exception."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.channels import DOCKING_STATE, FRAME, Channel
from common.config import CameraConfig, Config
from common.errors import DeviceError
from common.frames.ring import FrameReader, Image
from common.frames.source import Capture
from common.messages import DockingState, Frame, Header, StateCause, encode
from common.node import Inbox, NodeContext, Trigger
from common.timing import NS_PER_S, SteppedClock
from follower.camera.node import CameraNode
from follower.estimator.state import StateEstimator

SECOND = NS_PER_S
FRAME_NS = 16_666_667


@dataclass
class FakeSource:
    """A camera whose plug can be pulled; every image is one shade lighter than the one before."""

    trigger: Trigger = field(default_factory=lambda: Trigger(free=True))
    inputs: tuple[Channel[Any], ...] = ()
    plugged: bool = True
    late: bool = False
    gain: float = 1.0
    opened: int = 0
    closed: int = 0
    shade: int = 0
    exposures_us: list[float] = field(default_factory=list)

    def open(self) -> None:
        if not self.plugged:
            raise DeviceError("camera X: not there")
        self.opened += 1

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002
        if not self.plugged:
            raise DeviceError("camera X: lost")
        if self.late:
            return None
        self.shade += 1
        image[:] = self.shade
        return Capture(now_ns - 1000, 600.0, self.gain, "X")

    def expose(self, exposure_us: float) -> None:
        self.exposures_us.append(exposure_us)

    def close(self) -> None:
        self.closed += 1


@dataclass
class Rig:
    source: FakeSource
    node: CameraNode
    runtime: Path
    state: DockingState

    def step(self, now_ns: int, cause: StateCause | None = None) -> Frame | None:
        inbox = Inbox("boot")
        if cause is not None:
            state = replace(self.state, cause=cause)
            header = Header("follower-estimator", 1, 1, now_ns, "boot")
            inbox.put_state(DOCKING_STATE, encode(state, header), now_ns)
            inbox.begin_step()
        outputs = self.node.step(now_ns, inbox)
        if not outputs:
            return None
        ((channel, frame),) = outputs
        assert channel is FRAME
        assert isinstance(frame, Frame)
        return frame


@pytest.fixture
def rig(config: Config, tmp_path: Path) -> Rig:
    camera = CameraConfig.model_validate({**config.camera.model_dump(), "width_px": 96, "height_px": 64})
    robots = config.model_copy(update={"camera": camera})
    source = FakeSource()
    node = CameraNode(NodeContext(robots, tmp_path / "robots.toml", tmp_path, 1, SteppedClock(0)), source)
    node.start(0)
    return Rig(source, node, tmp_path, StateEstimator(config).no_frame(0, (0.0, 0.0)))


def test_frames_are_numbered_and_their_pixels_lie_in_the_ring(rig: Rig) -> None:
    reader = FrameReader(rig.runtime)
    for number in (1, 2, 3):
        frame = rig.step(number * SECOND)
        assert frame is not None
        assert (frame.sequence, frame.capture_ns, frame.camera_id) == (number, number * SECOND - 1000, "X")
        image = reader.read(frame)
        assert image is not None
        assert np.all(image == number)


def test_no_image_yet_takes_no_number(rig: Rig) -> None:
    rig.source.late = True
    assert rig.step(SECOND) is None
    rig.source.late = False
    frame = rig.step(SECOND + 1)
    assert frame is not None
    assert frame.sequence == 1


def test_a_lost_camera_is_closed_tried_once_a_second_and_goes_on_where_it_was(rig: Rig) -> None:
    assert rig.step(1 * SECOND) is not None
    rig.source.plugged = False
    assert rig.step(2 * SECOND) is None
    assert rig.source.closed == 1
    assert rig.step(3 * SECOND) is None, "tried and not there"
    rig.source.plugged = True
    assert rig.step(3 * SECOND + SECOND // 2) is None, "not tried before its second is over"
    assert rig.source.opened == 1
    assert rig.step(4 * SECOND) is None
    assert rig.source.opened == 2
    frame = rig.step(4 * SECOND + 1)
    assert frame is not None
    assert frame.sequence == 2, "no number twice, none left out"


@pytest.mark.parametrize("gain", [math.nan, 0.0, 5000.0])
def test_facts_that_no_camera_has_are_a_fault_of_the_device(
    rig: Rig, caplog: pytest.LogCaptureFixture, gain: float
) -> None:
    rig.source.gain = gain
    assert rig.step(SECOND) is None
    assert "X: gain = " in caplog.text
    assert rig.source.closed == 1


def test_stopping_closes_the_camera(rig: Rig) -> None:
    rig.node.stop(SECOND)
    assert rig.source.closed == 1


def test_a_camera_that_is_missing_at_the_start_says_so(config: Config, tmp_path: Path) -> None:
    context = NodeContext(config, tmp_path / "robots.toml", tmp_path, 1, SteppedClock(0))
    with pytest.raises(DeviceError, match="camera X: not there"):
        CameraNode(context, FakeSource(plugged=False)).start(0)


def test_another_exposure_is_asked_of_the_camera_and_forgotten_with_it(rig: Rig, config: Config) -> None:
    wanted_us = 4.0 * config.camera.exposure_us
    for step in range(10):
        rig.step(SECOND + step * FRAME_NS, "underexposed")
    assert rig.source.exposures_us == [wanted_us]
    rig.source.plugged = False
    rig.step(2 * SECOND)
    rig.source.plugged = True
    rig.step(3 * SECOND)
    for step in range(10):
        rig.step(4 * SECOND + step * FRAME_NS, "underexposed")
    assert rig.source.exposures_us == [wanted_us, wanted_us], "reopened with the configured one"
