"""Frames for tools: from a robot that runs, or straight from the camera of one that does not."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.bus import Bus
from common.channels import DOCKING_STATE, FRAME, Channel
from common.config import Config
from common.errors import ConfigError, DeviceError
from common.executor import earlier_processes
from common.frame_ring import FrameReader, Image
from common.frame_source import FrameSource, frame_source
from common.geometry import Array
from common.messages import DockingState, MessageError, decode
from common.node import Inbox, NodeContext
from common.timing import MonotonicClock

_FIRST_FRAME_S = 5.0
TOOL = "tool"


@dataclass(frozen=True)
class Shot:
    """One image (height, width), and the camera's name for itself, as ``driver:serial``."""

    image: Image
    camera_id: str


@contextmanager
def open_frames(config: Config, config_path: Path, runtime: Path) -> Iterator[Iterator[Shot]]:
    """Images as they come: of the running camera process if ``runtime`` is there, else of the driver.

    Raises:
        DeviceError: no frame came.
        ConfigError: the driver cannot be opened by itself.
    """
    if (runtime / "follower-camera.sock").exists():
        with Bus(TOOL, runtime, earlier_processes(TOOL), config.network.namespace) as bus:
            yield _running(bus, runtime)
        return
    clock = MonotonicClock()
    source = frame_source(NodeContext(config, config_path, runtime, 0, clock))
    if source.inputs:
        raise ConfigError(f"camera.driver = {config.camera.driver!r} needs a running simulation: name its --runtime")
    source.open()
    try:
        yield _direct(source, config, clock)
    finally:
        source.close()


def valid_states(bus: Bus, count: int) -> list[DockingState]:
    """``count`` states of a running estimator that show the whole array, or fewer: of twice as many all valid ones.

    Raises:
        DeviceError: none came.
    """
    waiting = _stream(bus, DOCKING_STATE)
    found: list[DockingState] = []
    whole = 0
    for _ in range(2 * count):
        state = decode(DockingState, _next(waiting, "docking state"))[1]
        if state.valid:
            found.append(state)
            whole += all(point is not None for point in state.features)
        if whole == count:
            break
    return found


def measured(state: DockingState) -> Array:
    """The state's features (n, 2), NaN where a LED was not seen."""
    return np.array([(np.nan, np.nan) if point is None else point for point in state.features])


def _running(bus: Bus, runtime: Path) -> Iterator[Shot]:
    waiting, reader = _stream(bus, FRAME), FrameReader(runtime)
    while True:
        try:
            _, frame = decode(FRAME.message, _next(waiting, "frame"))
        except MessageError as error:
            raise DeviceError(f"camera process: {error}") from error
        image = reader.read(frame)
        if image is not None:
            yield Shot(image, frame.camera_id)


def _direct(source: FrameSource, config: Config, clock: MonotonicClock) -> Iterator[Shot]:
    inbox = Inbox(clock.boot_id)
    give_up_ns = clock.now_ns() + round(_FIRST_FRAME_S * 1e9)
    while True:
        image = np.empty((config.camera.height_px, config.camera.width_px), np.uint8)
        capture = source.grab(clock.now_ns(), inbox, image)
        if capture is not None:
            give_up_ns = clock.now_ns() + round(_FIRST_FRAME_S * 1e9)
            yield Shot(image, capture.camera_id)
        elif clock.now_ns() > give_up_ns:
            raise DeviceError(f"camera {config.camera.driver}: no frame in {_FIRST_FRAME_S:.0f} s")


def _stream(bus: Bus, channel: Channel[Any]) -> queue.SimpleQueue[bytes]:
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    bus.stream(channel, waiting.put)
    return waiting


def _next(waiting: queue.SimpleQueue[bytes], what: str) -> bytes:
    try:
        return waiting.get(timeout=_FIRST_FRAME_S)
    except queue.Empty:
        raise DeviceError(f"no {what} in {_FIRST_FRAME_S:.0f} s: does the robot run?") from None
