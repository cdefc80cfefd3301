"""The record of a run: takes messages as they come, writes them and what viewers show of them."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import IO, Any

from common.channels import FRAME, Channel, channel_of
from common.config import Config
from common.errors import ConfigError
from common.frames.ring import FrameReader
from common.messages import DockingState, Frame, MessageError, NodeSnapshot, StepJournal, decode
from common.recording import pictures, scene
from common.recording.mcap_file import RunWriter
from common.recording.views import PREFIX, stamp_of, unpacked, view, view_schema
from common.timing import NS_PER_S

RUN_NOTE, CONFIGURATION_NOTE, DROPPED_NOTE = "davpc.run", "davpc.configuration", "davpc.dropped"
_UNSEEN = (StepJournal, NodeSnapshot)
WORLD_KEY = "world/state"


@dataclass(slots=True)
class Item:
    """What is to be recorded: a message as on the wire, and for a frame its picture and its pixels without loss."""

    key: str
    payload: bytes
    receipt_ns: int
    picture: bytes | None = None
    pixels: bytes | None = None
    capture_ns: int = 0


class FramePictures:
    """Adds pictures to the notes of frames, while the pixels are still in shared memory.

    Args:
        runtime: directory of the frames' ring.
        pictures_hz: so many frames a second as JPEG; 0 for none.
        quality: of JPEG.
        lossless: whether every frame is also packed without loss.
    """

    def __init__(self, runtime: Path, pictures_hz: float, quality: int, *, lossless: bool) -> None:
        self._reader = FrameReader(runtime)
        self._period_ns = NS_PER_S / pictures_hz if pictures_hz else 0.0
        self._quality, self._lossless = quality, lossless
        self._due_ns = 0.0

    def item(self, key: str, payload: bytes, receipt_ns: int) -> Item:
        """A message as an item; with its picture, if it is a frame whose turn it is."""
        if key != FRAME.key:
            return Item(key, payload, receipt_ns)
        due = self._period_ns > 0 and receipt_ns >= self._due_ns
        if not due and not self._lossless:
            return Item(key, payload, receipt_ns)
        try:
            frame: Frame = decode(Frame, payload)[1]
        except MessageError:
            return Item(key, payload, receipt_ns)
        image = self._reader.read(frame)
        if image is None:
            return Item(key, payload, receipt_ns)
        if due:
            self._due_ns = receipt_ns + 0.99 * self._period_ns
        picture = pictures.jpeg(image, self._quality) if due else None
        kept = pictures.lossless(image) if self._lossless else None
        return Item(key, payload, receipt_ns, picture, kept, frame.capture_ns)


class RunRecording:
    """One recording: signals and pictures in one file, lossless frames in another.

    Args:
        stream: a new file for the signals.
        config: of the run.
        about: what else is to be known of the run, such as its seed.
        views: whether what viewers show is written beside the wire's bytes.
        frames: a new file for lossless frames; None: they are not kept.
        frames_bytes: most bytes of that file.
        further: channels outside the table whose messages are to be shown too, such as the simulated world's.
    """

    def __init__(
        self,
        stream: IO[bytes],
        config: Config,
        about: dict[str, str],
        *,
        views: bool = True,
        frames: IO[bytes] | None = None,
        frames_bytes: int = 4_000_000_000,
        further: Sequence[Channel[Any]] = (),
    ) -> None:
        self._writer = RunWriter(stream)
        self._writer.note(RUN_NOTE, {**versions(), **about})
        self._writer.note(CONFIGURATION_NOTE, {"json": config.model_dump_json()})
        self._scene = scene.Drawing(config) if views else None
        self._frames = RunWriter(frames, compressed=False) if frames is not None else None
        self._frames_bytes = frames_bytes
        self._further = {channel.key: channel for channel in further}
        self._shown: dict[str, Channel[Any] | None] = {}
        self._dropped: dict[str, int] = {}
        self._calibrated = self._placed = False
        self._noted = True

    @property
    def size_bytes(self) -> int:
        """Bytes in both files."""
        return self._writer.size_bytes + (self._frames.size_bytes if self._frames is not None else 0)

    def add(self, item: Item) -> None:
        """Append one item."""
        key, log_ns = item.key, item.receipt_ns
        stamp_ns = stamp_of(item.payload)
        publish_ns = log_ns if stamp_ns is None else stamp_ns
        if not self._writer.known(key):
            self._declare(key)
        self._writer.add(key, item.payload, log_ns, publish_ns)
        if self._scene is not None:
            self._show_all(self._scene, item)
        if item.picture is not None:
            self._put(scene.IMAGE, scene.image(item.capture_ns, item.picture, "jpeg"), log_ns, item.capture_ns)
        if self._frames is not None and key == FRAME.key:
            if item.pixels is None:  # overwritten before it could be read
                self.drop(scene.FRAMES, 1)
            else:
                self._keep_pixels(self._frames, item)

    def drop(self, what: str, count: int) -> None:
        """Note that so many items of a channel are missing from here on, counted from the beginning."""
        self._dropped[what] = self._dropped.get(what, 0) + count
        self._noted = False

    def flush(self) -> None:
        """Hand everything to the operating system: a crash of this process loses nothing of it."""
        self._note_dropped()
        self._writer.flush()
        if self._frames is not None:
            self._frames.flush()

    def close(self) -> None:
        """Complete the files; their streams stay open."""
        self._note_dropped()
        self._writer.close()
        if self._frames is not None:
            self._frames.close()

    def _note_dropped(self) -> None:
        if not self._noted:
            self._noted = True
            self._writer.note(DROPPED_NOTE, {name: str(number) for name, number in self._dropped.items()})

    def _declare(self, key: str) -> None:
        channel = self._further.get(key) or channel_of(key)
        about = {} if channel is None else {"schema": channel.message.SCHEMA, "publisher": channel.publisher}
        self._writer.declare(key, "msgpack", None, about)
        self._shown[key] = None if channel is None or channel.message in _UNSEEN else channel

    def _show_all(self, drawn: scene.Drawing, item: Item) -> None:
        content, channel = unpacked(item.payload), self._shown[item.key]
        if content is None:
            return
        if channel is not None:
            self._show(drawn, channel, item, content)
        if item.key == WORLD_KEY:
            self._show_world(drawn, item, content[1])

    def _show(
        self,
        drawn: scene.Drawing,
        channel: Channel[Any],
        item: Item,
        content: tuple[dict[str, Any], dict[str, Any]],
    ) -> None:
        try:
            header, message = decode(channel.message, item.payload)
        except MessageError:
            return  # it is kept, but there is nothing that a viewer could show
        topic, kind, log_ns = PREFIX + channel.key, channel.message, item.receipt_ns
        if not self._writer.known(topic):
            self._writer.declare(topic, "json", view_schema(kind))
        self._writer.add(topic, view(*content), log_ns, header.stamp_ns)
        put = partial(self._put, log_ns=log_ns, publish_ns=header.stamp_ns)
        if not self._calibrated:
            self._calibrated = True
            put(scene.CALIBRATION, drawn.calibration(log_ns))
        if isinstance(message, DockingState):
            self._draw(drawn, message, put)

    def _show_world(self, drawn: scene.Drawing, item: Item, body: dict[str, Any]) -> None:
        """The trolleys of a simulated world, whose messages are not in the robots' table."""
        match body:
            case {"trolley": [float(), float(), float()] as held, "queue": list(queue)}:
                handles = [(x, y, theta) for x, y, theta in (held, *queue)]
                self._put(scene.SCENE, drawn.trolleys(item.receipt_ns, handles), item.receipt_ns, item.receipt_ns)

    def _draw(self, drawn: scene.Drawing, state: DockingState, put: Callable[[str, bytes], None]) -> None:
        put(scene.ANNOTATIONS, drawn.annotations(state))
        if state.valid:
            put(scene.TRANSFORMS, drawn.transforms(state))
            if not self._placed:
                self._placed = True
                put(scene.SCENE, drawn.scene(state))

    def _put(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        if not self._writer.known(topic):
            self._writer.declare(topic, "protobuf", scene.schema(topic))
        self._writer.add(topic, data, log_ns, publish_ns)

    def _keep_pixels(self, frames: RunWriter, item: Item) -> None:
        assert item.pixels is not None
        if frames.size_bytes + len(item.pixels) > self._frames_bytes:
            self.drop(scene.FRAMES, 1)
            return
        if not frames.known(scene.FRAMES):
            frames.declare(scene.FRAMES, "protobuf", scene.schema(scene.FRAMES))
        packed = scene.image(item.capture_ns, item.pixels, "png")
        frames.add(scene.FRAMES, packed, item.receipt_ns, item.capture_ns)


def frames_path(path: Path) -> Path:
    """Where the lossless frames of a recording are."""
    return path.with_suffix(".frames.mcap")


def versions() -> dict[str, str]:
    """What a replay has to have in common with the run to be exact."""
    found = {"python": platform.python_version(), "cpu": _cpu()}
    for name in ("davpc", "numpy", "opencv-python-headless", "daqp", "casadi", "pydantic"):
        found[name] = metadata.version(name)
    return found


def _cpu() -> str:
    """The processor's model: numerical libraries choose their code by it, and the last bit with it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n")
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def recorded_config(note: dict[str, str], origin: str) -> Config:
    """The configuration that a recording holds.

    Raises:
        ConfigError: it is none of this version.
    """
    try:
        return Config.model_validate_json(note.get("json", ""))
    except ValueError as error:
        raise ConfigError(f"{origin}: its configuration is not one of this version: {_first(error)}") from error


def _first(error: ValueError) -> str:
    return str(error).partition("\n")[0]


def json_note(content: dict[str, Any]) -> dict[str, str]:
    """Metadata as MCAP takes it: texts."""
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in content.items()}
