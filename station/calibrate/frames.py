"""Frames for tools: from a robot that runs, or straight from the camera of one that does not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.channels import DOCKING_STATE, FRAME
from common.config import Config
from common.errors import ConfigError, DeviceError
from common.frames.ring import FrameReader, Image
from common.frames.source import FrameSource, frame_source
from common.geometry import Array
from common.messages import DockingState, Frame, MessageError
from common.node import Inbox, NodeContext
from common.timing import MonotonicClock
from station.operate.link import RobotLink, Stream, running_or_installed, running_robot

_FIRST_FRAME_S = 5.0


@dataclass(frozen=True)
class CameraImage:
    """One image (height, width), and the camera's name for itself, as ``driver:serial``."""

    image: Image
    camera_id: str


@contextmanager
def open_frames(config: Config, config_path: Path, runtime: Path | None) -> Iterator[Iterator[CameraImage]]:
    """Images as they come: of the running camera process if there is one, else of the driver.

    Args:
        config: the robots.
        config_path: where it was read from.
        runtime: folder of the running robot's frames; None: of the robot that runs here.

    Raises:
        DeviceError: no frame came.
        ConfigError: the driver cannot be opened by itself.
    """
    folder = running_or_installed(runtime)
    if (folder / "follower-camera.sock").exists():
        with RobotLink(folder, config.network.namespace) as link:
            yield _running(link.stream(FRAME), folder)
        return
    clock = MonotonicClock()
    source = frame_source(NodeContext(config, config_path, folder, 0, clock))
    if source.inputs:
        raise ConfigError(f"camera.driver = {config.camera.driver!r} needs a running simulation: name its --runtime")
    source.open()
    try:
        yield _direct(source, config, clock)
    finally:
        source.close()


def valid_states(config: Config, runtime: Path | None, count: int) -> list[DockingState]:
    """``count`` states of a running estimator that show the whole array, or fewer: of twice as many all valid ones.

    Args:
        config: the robots.
        runtime: folder of the running robot's sockets; None: of the robot that runs here.
        count: states that show every LED.

    Raises:
        DeviceError: no robot runs here, or no state came.
    """
    found: list[DockingState] = []
    whole = 0
    with RobotLink(running_robot(runtime), config.network.namespace) as link:
        stream = link.stream(DOCKING_STATE)
        for _ in range(2 * count):
            state: DockingState = _next(stream, "docking state")
            if state.valid:
                found.append(state)
                whole += all(point is not None for point in state.features)
            if whole == count:
                break
    return found


def measured(state: DockingState) -> Array:
    """The state's features (n, 2), NaN where a LED was not seen."""
    return np.array([(np.nan, np.nan) if point is None else point for point in state.features])


def _running(stream: Stream, runtime: Path) -> Iterator[CameraImage]:
    reader = FrameReader(runtime)
    while True:
        frame: Frame = _next(stream, "frame")
        image = reader.read(frame)
        if image is not None:
            yield CameraImage(image, frame.camera_id)


def _direct(source: FrameSource, config: Config, clock: MonotonicClock) -> Iterator[CameraImage]:
    inbox = Inbox(clock.boot_id)
    give_up_ns = clock.now_ns() + round(_FIRST_FRAME_S * 1e9)
    while True:
        image = np.empty((config.camera.height_px, config.camera.width_px), np.uint8)
        capture = source.grab(clock.now_ns(), inbox, image)
        if capture is not None:
            give_up_ns = clock.now_ns() + round(_FIRST_FRAME_S * 1e9)
            yield CameraImage(image, capture.camera_id)
        elif clock.now_ns() > give_up_ns:
            raise DeviceError(f"camera {config.camera.driver}: no frame in {_FIRST_FRAME_S:.0f} s")


def _next(stream: Stream, what: str) -> Any:
    try:
        item = stream.next(_FIRST_FRAME_S)
    except MessageError as error:
        raise DeviceError(f"{error}: is the robot of another version?") from error
    if item is None:
        raise DeviceError(f"no {what} in {_FIRST_FRAME_S:.0f} s: does the robot run?")
    return item[2]
