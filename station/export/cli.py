"""``davpc export`` and ``davpc trace``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from common.errors import DeviceError
from common.messages import MessageError
from common.recording.recording import Recording
from common.timing import NS_PER_S
from station.export.latency import LatencyTrace, as_table, of_recording
from station.export.tables import Form, export
from station.export.viewers import write_views
from station.operate.link import RobotLink, running_robot
from station.options import ConfigOption, OutOption, RuntimeOption, loaded

tables_app, trace_app = typer.Typer(), typer.Typer()


@tables_app.command("export", epilog="Example:  davpc export out/run3/run.mcap --to csv --out out/tables")
def write_tables(
    file: Annotated[Path, typer.Argument(help="recording")],
    form: Annotated[
        Literal[Form, "foxglove"], typer.Option("--to", help="tables, or an MCAP file with all that viewers show")
    ] = "csv",
    out: OutOption = Path("out/tables"),
) -> None:
    """Write one table a channel, with units in the header, or a file for viewers. `davpc export run.mcap --to npz`"""
    recording = Recording.read(file)
    if form == "foxglove":
        written = [write_views(recording, out / f"{file.stem}.foxglove.mcap")]
    else:
        written = export(recording, form, out)
    typer.echo(f"written: {', '.join(map(str, written))}")


@trace_app.command("trace", epilog="Example:  davpc trace out/run3/run.mcap --picture out/latency.png")
def trace(
    file: Annotated[Path | None, typer.Argument(help="recording", show_default="the robot that runs here")] = None,
    seconds: Annotated[float, typer.Option(min=1.0, max=600.0, help="without a file: how long to listen")] = 10.0,
    picture: Annotated[Path | None, typer.Option(help="histogram to write")] = None,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
) -> None:
    """Show how long an image takes to the CAN bus, hop by hop. `davpc trace run.mcap`"""
    if file is not None:
        found = of_recording(Recording.read(file))
    else:
        found = _live(running_robot(runtime), loaded(config, None).network.namespace, seconds)
    hops_ms = found.hops_ms()
    if not any(hops_ms.values()):
        raise DeviceError("no image led to a command: does a docking run?")
    typer.echo(as_table(hops_ms))
    if picture is not None:
        from station.export import figures  # noqa: PLC0415 - it needs matplotlib, which is optional

        typer.echo(f"written: {figures.draw(hops_ms, picture)}")


def _live(runtime: Path, namespace: str, seconds: float) -> LatencyTrace:
    found = LatencyTrace()
    with RobotLink(runtime, namespace) as link:
        stream = link.stream(*LatencyTrace.CHANNELS)
        end_ns = link.now_ns + round(seconds * NS_PER_S)
        while link.now_ns < end_ns:
            try:
                item = stream.next(0.2)
            except MessageError as error:
                print(f"davpc: {error}", file=sys.stderr)  # noqa: T201 - a fault that nothing else reports
                continue
            if item is not None:
                channel, header, message = item
                found.take(channel.key, header.stamp_ns, message)
    return found
