"""``davpc doctor``: whether this computer, this robot and their surroundings are fit to dock; only looks."""

from __future__ import annotations

import json
import os
import sys
import threading
from enum import StrEnum
from typing import Annotated

import typer

from common.config import default_config_path
from gateway.access import Robot
from station.doctor.examination import Examination, default_robots
from station.doctor.findings import PROBING, as_table, is_well, summary
from station.doctor.probes import installed_role
from station.operate.link import running_or_installed
from station.options import ConfigOption, JsonOption, RuntimeOption, SetOption

examine = typer.Typer()


class RobotChoice(StrEnum):
    """Which robot's parts to look at."""

    FOLLOWER = "follower"
    LEADER = "leader"
    BOTH = "both"


_ROBOTS: dict[RobotChoice, tuple[Robot, ...]] = {
    RobotChoice.FOLLOWER: ("follower",),
    RobotChoice.LEADER: ("leader",),
    RobotChoice.BOTH: ("follower", "leader"),
}


@examine.command(epilog="Example:  sudo davpc doctor --robot follower")
def doctor(
    robot: Annotated[
        RobotChoice | None, typer.Option(help="which robot's parts", show_default="as installed, else both")
    ] = None,
    devices: Annotated[bool, typer.Option(help="open camera and CAN bus if no process of davpc uses them")] = True,
    as_json: JsonOption = False,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Look at everything a docking depends on: one line a check, with what to do. `sudo davpc doctor`

    Only reads: nothing moves, is enabled or changed, whether davpc runs or not. Exit code 1 if a check failed.
    """
    role = installed_role()
    robots = default_robots(role) if robot is None else _ROBOTS[robot]
    hardware = role is not None and role[1] == "hardware"
    examination = Examination(
        robots, running_or_installed(runtime), config or default_config_path(), overrides or (), devices, hardware
    )
    findings = []
    for finding in examination.findings():
        findings.append(finding)
        if not as_json:
            typer.echo(finding.line())
    typer.echo(json.dumps(as_table(findings), ensure_ascii=False) if as_json else summary(findings))
    code = 0 if is_well(findings) else 1
    if any(thread.name == PROBING for thread in threading.enumerate()):
        # a probe hangs in a driver that cannot be interrupted: do not wait for it
        sys.stdout.flush()
        os._exit(code)
    raise typer.Exit(code)
