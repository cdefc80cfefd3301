"""Clock and devices of a replayed node: they return what the journal holds, in its order."""

from __future__ import annotations

from collections import deque
from typing import Any

import msgpack
from pydantic import ValidationError

from common.recording.devices import ERROR, PIXELS, adapter, return_type, unpacked_error
from common.recording.recording import RecordedFrames
from common.recording.steps import JournaledStep


class DivergedError(RuntimeError):
    """The replayed node asks for something else than the recorded one did; one line that says what."""


class RecordedClock:
    """Each reading within a step as it was; any further one is the last."""

    def __init__(self, boot_id: str) -> None:
        self.boot_id = boot_id
        self._now_ns = 0
        self._reads: deque[int] = deque()

    def begin(self, step: JournaledStep) -> None:
        """The step begins."""
        self._now_ns = step.now_ns
        self._reads = deque(step.reads_ns)

    def now_ns(self) -> int:
        """As recorded."""
        if self._reads:
            self._now_ns = self._reads.popleft()
        return self._now_ns


class RecordedWatch:
    """Stands in a node's context for the journal: its devices return what the journal holds."""

    def __init__(self, frames: RecordedFrames) -> None:
        self._frames = frames
        self._calls: deque[tuple[str, int, Any]] = deque()
        self.devices: dict[str, RecordedDevice] = {}

    def begin(self, step: JournaledStep) -> None:
        """The step begins."""
        self._calls = deque(step.calls)

    def states(self, arrived: object, late: object) -> None:
        """Nothing is journaled in a replay."""

    def taken(self, key: object, received: object) -> None:
        """Nothing is journaled in a replay."""

    def device(self, name: str, device: Any) -> Any:
        """What stands for the device."""
        self.devices[name] = RecordedDevice(name, device, self)
        return self.devices[name]

    def result(self, name: str, kind: Any, asked: tuple[Any, ...]) -> Any:
        """What the device returned then.

        Raises:
            DivergedError: it was not asked then, or returned something of another type.
        """
        found, form, packed = self._calls.popleft() if self._calls else ("nothing more", -1, None)
        if found != name:
            raise DivergedError(f"the node asks for {name}, the recorded one asked for {found}")
        if form == ERROR:
            raise unpacked_error(packed)
        if form == PIXELS:
            return self._image(asked) if packed else None
        packer = adapter(kind)
        try:
            return packer.validate_python(msgpack.unpackb(packed, use_list=False)) if packer is not None else None
        except (ValidationError, ValueError) as error:
            raise DivergedError(f"{name} returned something else in the version that recorded it") from error

    def _image(self, asked: tuple[Any, ...]) -> Any:
        (frame,) = asked
        image = self._frames.at(frame.capture_ns)
        if image is None:
            raise DivergedError(
                f"frame {frame.sequence} is not recorded"
                if self._frames.there
                else 'the frames are not recorded: record with --frames all, or recorder.frames = "all"'
            )
        return image


class RecordedDevice:
    """Stands for one device of a node; calls that return nothing do nothing."""

    def __init__(self, name: str, device: Any, watch: RecordedWatch) -> None:
        self.__dict__.update(_name=name, _device=device, _watch=watch)

    def __getattr__(self, attribute: str) -> Any:
        name, value = f"{self._name}.{attribute}", getattr(self._device, attribute)
        if not callable(value):
            return self._watch.result(name, type(value), ())
        kind = return_type(value)
        if kind is None:
            return lambda *_args, **_kwargs: None
        return lambda *args, **_kwargs: self._watch.result(name, kind, args)
