"""How ``davpc doctor`` looks at the computer: packages, units, clock, sysfs, camera. Everything here only reads."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from common.config import CameraConfig, Config
from common.errors import ConfigError, DeviceError
from common.frames.source import frame_source
from common.node import Inbox, NodeContext
from common.processes import PROCESSES
from common.timing import NS_PER_S, MonotonicClock
from follower.estimator.spots import SpotRule
from station.calibrate.focus import focus_report
from station.doctor.machine import UnitState, canonical
from station.options import ROBOT

_COMMAND_S = 5.0
_ROBOT_FILE = Path("/etc/davpc/robot")
_MINDVISION = "f622"
_SYSTEMD = Path("/run/systemd/system")
_USB = Path("/sys/bus/usb/devices")
_VIDEO = Path("/sys/class/video4linux")


def installed_role() -> tuple[str, str] | None:
    """Which robot the installer made of this computer, and whether it is ``hardware`` or ``simulated``."""
    try:
        words = _ROBOT_FILE.read_text(encoding="utf-8").split()
    except OSError:
        return None
    return (words[0], words[1]) if len(words) == 2 else None


def installed_packages() -> dict[str, str]:
    """Version by canonical name of all packages of this environment."""
    return {canonical(found.metadata["Name"]): found.version for found in metadata.distributions()}


def needed_packages() -> list[str]:
    """Canonical names of what davpc itself needs, without its extras."""
    texts = [text for text in metadata.requires("davpc") or () if "extra ==" not in text]
    return [canonical(re.split(r"[^A-Za-z0-9._-]", text, maxsplit=1)[0]) for text in texts]


def lock_text() -> str | None:
    """The lock that this environment was made from: of the working copy, or of the installed release."""
    source = Path(__file__).resolve().parents[2]
    release = Path(sys.prefix) / "share/davpc/deploy"
    for path in (source / "requirements.lock", release / "requirements.lock"):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def newest_file_s() -> float:
    """When the newest of davpc's own source files was written, by the wall clock of that time."""
    return max(path.stat().st_mtime for path in Path(__file__).parents[1].rglob("*.py"))


def clock_synchronised() -> bool | None:
    """As timedatectl reports it; None without it."""
    output = _output(["timedatectl", "show", "--property=NTPSynchronized", "--value"])
    return {"yes": True, "no": False}.get(output.strip()) if output is not None else None


def clock_offset_s() -> float:
    """Wall clock minus monotonic clock: it changes only when the wall clock is set or slewed."""
    return time.time() - time.monotonic()


def unit_states(names: Iterable[str]) -> dict[str, UnitState] | None:
    """What systemd reports of units; None where it does not run.

    Raises:
        DeviceError: it runs, and does not answer.
    """
    if not _SYSTEMD.is_dir():
        return None
    fields = "Id,LoadState,ActiveState,Result,NRestarts"
    output = _output(["systemctl", "show", f"--property={fields}", *names])
    if output is None:
        raise DeviceError(f"systemctl did not answer within {_COMMAND_S:.0f} s")
    return parse_units(output)


def parse_units(output: str) -> dict[str, UnitState]:
    """Blocks of ``systemctl show``, separated by empty lines."""
    blocks = [dict(line.split("=", 1) for line in block.split("\n") if "=" in line) for block in output.split("\n\n")]
    return {
        block["Id"]: UnitState(
            block.get("LoadState", ""),
            block.get("ActiveState", ""),
            block.get("Result", ""),
            int(block.get("NRestarts") or 0),
        )
        for block in blocks
        if "Id" in block
    }


def fifo_priorities(runtime: Path, names: Sequence[str]) -> dict[str, int | None]:
    """SCHED_FIFO priority of each running process of a robot, None for another policy."""
    found: dict[str, int | None] = {}
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            name = process_of(command.read_bytes().decode(errors="replace").split("\0"), runtime)
            if name in names:
                pid = int(command.parent.name)
                fifo = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
                found[name] = os.sched_getparam(pid).sched_priority if fifo else None
        except OSError:  # it ended meanwhile, or belongs to another user
            continue
    return found


def process_of(words: Sequence[str], runtime: Path) -> str:
    """The process of the table that a command line is of, if it runs in this folder; else ""."""
    if "run" not in words[:-1]:
        return ""
    name = words[words.index("run") + 1]
    folder = words[words.index("--runtime") + 1] if "--runtime" in words[:-1] else ROBOT
    return name if name in {entry.name for entry in PROCESSES} and Path(folder) == runtime else ""


def realtime_allowed() -> bool:
    """Whether this user may ask for real-time priorities."""
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    return os.geteuid() == 0 or limit == resource.RLIM_INFINITY or limit >= max(e.priority for e in PROCESSES)


def usb_speed_mbit_s(camera: CameraConfig) -> float:
    """Speed of the camera's USB link.

    Raises:
        DeviceError: there is no such USB device.
    """
    if camera.driver == "v4l2":
        node = _VIDEO / Path(camera.device or "/dev/video0").resolve().name / "device"
        folders = [folder for folder in (node.resolve(), *node.resolve().parents) if (folder / "speed").is_file()]
    else:
        vendors = _USB.glob("*/idVendor")
        folders = [path.parent for path in vendors if path.read_text().strip() == _MINDVISION]
    if not folders:
        raise DeviceError("no camera is on USB here")
    return float((folders[0] / "speed").read_text())


def can_link(channel: str) -> Mapping[str, Any]:
    """The kernel's view of a CAN interface.

    Raises:
        DeviceError: there is none of this name.
    """
    output = _output(["ip", "-details", "-json", "link", "show", "dev", channel])
    tables = json.loads(output) if output else []
    if not tables:
        raise DeviceError(f"there is no interface {channel}")
    table: Mapping[str, Any] = tables[0]
    return table


@dataclass(frozen=True)
class CameraSample:
    """What a camera gave: capture times, its name for itself, spots in the last image."""

    stamps_ns: tuple[int, ...]
    camera_id: str
    spots: int


def grab(config: Config, config_path: Path, runtime: Path, seconds: float) -> CameraSample:
    """Open the configured camera, which no process may have open, and take frames for a while.

    Args:
        config: the robots.
        config_path: where it was read from.
        runtime: folder of the running robot's frames.
        seconds: how long.

    Raises:
        DeviceError: it is missing or gives nothing.
        ConfigError: no such driver, or one that needs a running simulation.
    """
    clock = MonotonicClock()
    source = frame_source(NodeContext(config, config_path, runtime, 0, clock))
    if source.inputs:
        raise ConfigError(f"driver {config.camera.driver} needs a running simulation")
    image = np.empty((config.camera.height_px, config.camera.width_px), np.uint8)
    stamps, camera_id, inbox = list[int](), "", Inbox(clock.boot_id)
    source.open()
    try:
        end_ns = clock.now_ns() + round(seconds * NS_PER_S)
        while (now_ns := clock.now_ns()) < end_ns:
            capture = source.grab(now_ns, inbox, image)
            if capture is None:
                clock.sleep_until(now_ns + NS_PER_S // 1000)
            else:
                stamps.append(capture.capture_ns)
                camera_id = capture.camera_id
    finally:
        source.close()
    rule = SpotRule(config.estimator.threshold, config.estimator.min_spot_px, config.estimator.max_spot_px)
    return CameraSample(tuple(stamps), camera_id, focus_report(image, rule).spots if stamps else 0)


def _output(command: Sequence[str]) -> str | None:
    """Standard output of a command, None if it is not there, fails or does not end."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout
