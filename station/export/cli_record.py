"""``davpc record``: the running robot into a file, from now on."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from common.errors import DeviceError
from common.recording.files import RecordingFiles
from common.recording.live import LiveRecording
from common.recording.run import FramePictures, frames_path
from common.timing import NS_PER_S
from station.interrupts import interruptible
from station.operate.link import RobotLink, running_robot
from station.options import ConfigOption, FramesOption, RuntimeOption, SetOption, loaded, writable

record_app = typer.Typer()
_LOOK_S = 0.2


@record_app.command("record", epilog="Example:  davpc record --seconds 60 --out out/now.mcap")
def record(
    out: Annotated[Path, typer.Option(callback=writable, help="file to write")],
    seconds: Annotated[float, typer.Option(min=1.0, max=7200.0, help="how long; Ctrl-C ends it before")] = 600.0,
    frames: FramesOption = "pictures",
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Record the robot that runs here, beside what it records of dockings. `davpc record --out now.mcap`"""
    settings, folder, lossless = loaded(config, overrides), running_robot(runtime), frames == "all"
    chosen = settings.recorder
    try:
        files = RecordingFiles(out, settings, {"source": "davpc record"}, lossless=lossless, views=chosen.views)
    except OSError as error:
        raise DeviceError(f"{out}: cannot be written: {error.strerror}") from error
    pictures = FramePictures(folder, chosen.pictures_hz, chosen.picture_quality, lossless=lossless)
    with (
        interruptible() as interrupted,
        closing(LiveRecording(files, pictures)) as live,
        RobotLink(folder, settings.network.namespace) as link,
    ):
        link.overhear(live.put)
        end_ns = link.now_ns + round(seconds * NS_PER_S)
        while link.now_ns < end_ns and not interrupted() and not live.fault:
            link.pause(_LOOK_S)
    if live.fault:
        raise DeviceError(f"the recording ends early: {live.fault}")
    written = [out, *([frames_path(out)] if lossless else [])]
    typer.echo(f"written: {', '.join(map(str, written))}; {live.dropped} messages dropped")
