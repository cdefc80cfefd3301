"""The record that ``davpc sim --record`` leaves: ``run.mcap``, and ``run.frames.mcap`` with every frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.channels import Channel
from sim.world_message import WORLD
from station.simulate.run import Run

if TYPE_CHECKING:
    from common.recording.files import RecordingFiles
    from common.recording.run import FramePictures

RECORDING, STEPPED = "run.mcap", "stepped"


@contextmanager
def stepped_recording(run: Run, runtime: Path) -> Iterator[Callable[[Channel[Any], bytes, int], None]]:
    """What takes every message of a run in stepped time; completes the files at the end.

    Args:
        run: with ``record`` false nothing is written.
        runtime: directory of the frames' ring.

    Raises:
        ConfigError: the libraries for recording are not installed.
    """
    if not run.record:
        yield lambda _channel, _payload, _time_ns: None
        return
    pictures = _pictures(run, runtime)
    with closing(_files(run, STEPPED)) as files:
        yield lambda channel, payload, time_ns: files.take(pictures.item(channel.key, payload, time_ns))


@contextmanager
def live_recording(run: Run, runtime: Path) -> Iterator[Callable[[str, bytes, int], None]]:
    """The same for a run of processes; takes keys, and returns at once."""
    if not run.record:
        yield lambda _key, _payload, _receipt_ns: None
        return
    from common.recording.live import LiveRecording  # noqa: PLC0415 - optional

    with closing(LiveRecording(_files(run, "processes"), _pictures(run, runtime))) as live:
        yield live.put


def _pictures(run: Run, runtime: Path) -> FramePictures:
    from common.recording.run import FramePictures  # noqa: PLC0415 - optional

    chosen = run.config.recorder
    return FramePictures(runtime, chosen.pictures_hz, chosen.picture_quality, lossless=run.frames)


def _files(run: Run, mode: str) -> RecordingFiles:
    from common.recording.files import RecordingFiles  # noqa: PLC0415 - optional
    from common.recording.run import json_note  # noqa: PLC0415

    world = run.world
    about = {"scene": world.scene, "seed": world.seed, "start": list(world.start), "source": f"davpc sim, {mode}"}
    path = run.out / RECORDING
    return RecordingFiles(
        path, run.config, json_note(about), lossless=run.frames, views=mode == STEPPED, further=(WORLD,)
    )
