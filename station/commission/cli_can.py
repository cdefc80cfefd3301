"""``davpc can``: which nodes are on a bus, what they do, and whether each axis does what it is commanded."""

from __future__ import annotations

import json
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.live import Live
from rich.table import Table

from common.config import Config, default_config_path
from common.errors import DeviceError
from common.processes import process
from common.timing import MonotonicClock
from follower.can_bridge.measurement import BusMeasurement
from station.commission.can_tools import Monitor, NodeRow, follower_names
from station.commission.can_tools import scan as ask
from station.commission.eds_check import refusal
from station.commission.enable_test import EnableTest
from station.commission.homing import Homing
from station.options import ConfigOption, JsonOption, SetOption, loaded

can = typer.Typer(no_args_is_help=True, help="Look at a CAN bus and test its axes. `davpc can scan`")


@can.command(epilog="Example:  davpc can scan --bus leader")
def scan(
    bus: Annotated[Literal["follower", "leader"], typer.Option(help="which robot's bus")] = "follower",
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """List the nodes that answer, with their identity. Only reads."""
    robots = loaded(config, overrides)
    if bus == "follower":
        found = ask(robots.follower_can.bus, follower_names(robots, _path(config)))
    else:
        found = ask(robots.leader_can.bus, {robots.leader_can.io_node_id: "leader I/O"})
    typer.echo("node  profile  vendor    product   serial      state            name")
    for node in found:
        identity = f"{node.vendor:08X}  {node.product:08X}  {node.serial:<10d}"
        typer.echo(f"{node.node_id:4d}  {node.profile:7s}  {identity}  {node.state:15s}  {node.name or 'unknown'}")
    if not found:
        raise DeviceError(f"CAN bus {bus}: no node answers; power, termination, bitrate?")


@can.command("check-eds", epilog="Example:  davpc can check-eds drives/*.eds")
def check_eds(
    files: Annotated[list[Path], typer.Argument(help="EDS or DCF files of drives")],
    json_output: JsonOption = False,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Say, without a bus, whether davpc can drive such devices, and what is missing. Exit code 1 if one it cannot."""
    robots = loaded(config, overrides)
    reports = [report for file in files for report in refusal(file, robots)]
    if json_output:
        typer.echo(json.dumps([asdict(report) for report in reports]))
    else:
        for report in reports:
            typer.echo(f"{report.file:32s} {report.use:15s} {'; '.join(report.missing) or 'ok'}")
    if any(report.missing for report in reports):
        raise typer.Exit(1)


@can.command(epilog="Example:  davpc can monitor --seconds 60")
def monitor(
    seconds: Annotated[float, typer.Option(min=0, help="0: until Ctrl-C")] = 0,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Follow the drives of a bus on which a bridge works, live: position, velocity, torque, age. Sends nothing."""
    follower, clock = Monitor(loaded(config, overrides), _path(config)), MonotonicClock()
    follower.open()
    end_ns = clock.now_ns() + round(seconds * 1e9)
    try:
        with Live(refresh_per_second=5) as live:
            while not seconds or clock.now_ns() < end_ns:
                live.update(_monitor_table(*follower.poll(clock.now_ns())))
                time.sleep(0.05)
    finally:
        follower.close()


@can.command("enable-test", epilog="Example:  davpc can enable-test --wheels-are-up")
def enable_test(
    wheels_are_up: Annotated[
        bool, typer.Option("--wheels-are-up", help="confirm that the wheels are off the ground")
    ] = False,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Turn each axis in both directions, try each limit, let the watchdog trip. No bridge may be running."""
    if not wheels_are_up:
        raise typer.BadParameter("lift the wheels off the ground, then give --wheels-are-up")
    _request_real_time()
    robots: Config = loaded(config, overrides)
    for check in EnableTest(robots, _path(config), MonotonicClock()).run():
        typer.echo(f"{'ok  ' if check.passed else 'FAIL'}  {check.name:28s} {check.result}")
        if not check.passed:
            raise typer.Exit(1)


@can.command(epilog="Example:  davpc can home --arms-are-free")
def home(
    arms_are_free: Annotated[
        bool, typer.Option("--arms-are-free", help="confirm that the arms hold nothing")
    ] = False,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Find the home of each axis that has no absolute encoder, one after the other. No bridge may be running."""
    if not arms_are_free:
        raise typer.BadParameter("arms and lift will move: clear their way, then give --arms-are-free")
    _request_real_time()
    robots: Config = loaded(config, overrides)
    for check in Homing(robots, _path(config), MonotonicClock()).run():
        typer.echo(f"{'ok  ' if check.passed else 'FAIL'}  {check.name:28s} {check.result}")
        if not check.passed:
            raise typer.Exit(1)


def _request_real_time() -> None:
    """Real-time priority, as the bridge has it, where allowed: a heartbeat 80 ms late stops the drives."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(process("follower-can-bridge").priority))
    except OSError as error:
        typer.echo(
            f"no real-time priority ({error.strerror}): on a busy machine the drives may end this early", err=True
        )


def _monitor_table(rows: list[NodeRow], measured: BusMeasurement) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("", "name", "state"):
        table.add_column(heading, no_wrap=True)
    for heading in ("rad, m", "rad/s", "N·m", "ms"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("faults")
    for row in rows:
        values = f"{row.position:+.3f}", f"{row.velocity:+.3f}", f"{row.torque_n_m:+.2f}", f"{row.age_ms:.0f}"
        table.add_row(str(row.node_id), row.name, row.state, *values, "; ".join(row.faults))
    clear = "clear" if measured.estop_clear and measured.protective_clear else "STOP"
    battery = "not readable" if measured.battery_v is None else f"{measured.battery_v:.1f} V"
    table.caption = f"stop inputs {clear}, battery {battery}, malformed {measured.malformed}"
    if measured.measured_ns < 0:
        table.caption = "no SYNC received: no bridge works on this bus; davpc can scan asks the nodes"
    return table


def _path(config: Path | None) -> Path:
    return config or default_config_path()
