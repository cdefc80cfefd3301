"""The interface of cameras to the camera process: real, recorded and simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Protocol

from common.channels import Channel
from common.errors import ConfigError
from common.frames.ring import Image
from common.node import Inbox, NodeContext, Trigger

ENTRY_POINTS = "davpc.frame_sources"


@dataclass(frozen=True)
class Capture:
    """An image without its pixels; ``capture_ns`` is the middle of the exposure."""

    capture_ns: int
    exposure_us: float
    gain: float
    camera_id: str


class FrameSource(Protocol):
    """A camera. ``trigger`` makes the camera process step, ``inputs`` are channels that the source reads."""

    trigger: Trigger
    inputs: tuple[Channel[Any], ...]

    def open(self) -> None:
        """Open the device.

        Raises:
            DeviceError: it is not there or refuses; the text names it and what to do.
        """

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:
        """Take the next image.

        Args:
            now_ns: time of the step.
            inputs: messages of the channels in ``inputs``.
            image: (height, width) uint8 grey levels, written in place.

        Returns:
            The capture; None if there is no new image.

        Raises:
            DeviceError: the device was lost; the camera process reopens it.
        """

    def expose(self, exposure_us: float) -> None:
        """Change the exposure from the next image on, until the device is reopened.

        A source that cannot change it logs that. Each capture reports the exposure in use.
        """

    def close(self) -> None:
        """Close the device; harmless if it is not open."""


def frame_source(context: NodeContext) -> FrameSource:
    """The source that the configuration names.

    Raises:
        ConfigError: no such driver; the text lists the known ones.
    """
    driver = context.config.camera.driver
    found = {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}
    if driver not in found:
        known = ", ".join(sorted(found))
        raise ConfigError(f"{context.config_path}: camera.driver: no driver {driver!r}; there are: {known}")
    make: Callable[[NodeContext], FrameSource] = found[driver].load()
    return make(context)
