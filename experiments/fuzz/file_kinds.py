"""The files that processes read: configuration, overrides, object dictionaries, calibration, and what they keep."""

from __future__ import annotations

import json
import tempfile
from datetime import date
from pathlib import Path

import numpy as np

from common.canopen.eds import load_device_file
from common.config import Config, default_config_path, load_config
from common.errors import ConfigError
from common.files.parsing import UnreadableError, read_text
from common.geometry import Pose2, features_at
from common.messages import Answer
from common.node import NodeContext
from common.processes import process
from common.request_desk import RequestDesk
from common.timing import SteppedClock
from experiments.fuzz.files import FileKind
from follower.camera.calibration_file import age_days, stored, unlike
from follower.can_bridge.bridge import Bridge
from follower.model.taught import Taught, calibration_hash, save, taught_images, taught_name
from follower.supervisor.sequence import DockingSequence
from leader import queue_file
from leader.sequence import LeaderSequence

_MADE = ("follower-arms", "follower-controller", "follower-estimator")
_TODAY = date(2026, 1, 1)


def _config_example(_config: Config) -> bytes:
    return default_config_path().read_bytes()


def _read_config(path: Path, _config: Config) -> str:
    return _used(load_config(path))


def _override_example(config: Config) -> bytes:
    """One override of each key, a line each."""
    lines: list[str] = []

    def walk(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                walk(f"{prefix}.{key}" if prefix else key, item)
        else:
            lines.append(f"{prefix}={json.dumps(value)}")

    walk("", config.model_dump(mode="json"))
    return "\n".join(lines).encode()


def _read_override(path: Path, _config: Config) -> str:
    return _used(load_config(default_config_path(), [path.read_bytes().decode(errors="surrogateescape")]))


def _used(config: Config) -> str:
    """What was accepted can be used: the cores of the processes can be made from it."""
    Bridge(config, "boot")
    LeaderSequence(config.leader, config.leds, 0)
    DockingSequence(config, 0, None)
    for name in _MADE:
        process(name).factory()(NodeContext(config, default_config_path(), Path(), 1, SteppedClock()))
    points = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    calibration_hash(config.camera)
    return "" if np.isfinite(config.leds.points).all() and points.shape[1] == 2 else "accepted, not usable"


def _dictionary_example(config: Config) -> bytes:
    path = default_config_path().parent / config.follower_can.drive_eds
    return path.read_bytes()


def _read_dictionary(path: Path, _config: Config) -> str:
    load_device_file.cache_clear()
    return "" if load_device_file(path, 1).dictionary.names else "accepted a dictionary without objects"


def _calibration_example(config: Config) -> bytes:
    camera = config.camera
    lens = camera.lens.model_dump(mode="json", exclude_none=True)
    head = {
        "camera": "0123",
        "date": "2026-01-01",
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "rms_px": 0.21,
        "held_out_px": 0.24,
        "coverage": 0.8,
        "views": 40,
    }
    lines = [f"{key} = {json.dumps(value)}" for key, value in head.items()]
    lines += ["", "[lens]", *(f"{key} = {json.dumps(value)}" for key, value in lens.items())]
    return ("\n".join(lines) + "\n").encode()


def _read_calibration(path: Path, config: Config) -> str:
    calibration = stored(path)
    unlike(calibration, config.camera)
    age_days(calibration, _TODAY, path)
    return ""


def _taught_example(config: Config) -> bytes:
    features = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    image = Taught(1, features, 0.1, Pose2(1.5, 0.0, 0.0), calibration_hash(config.camera), 0.4, 40)
    with tempfile.TemporaryDirectory(prefix="davpc-fuzz-") as folder:
        path = Path(folder) / taught_name(1)
        save(image, path)
        return path.read_bytes()


def _read_taught(path: Path, config: Config) -> str:
    docking = config.docking.model_copy(update={"taught_dir": str(path.parent)})
    images = taught_images(config.model_copy(update={"docking": docking}), path.parent / "robots.toml")
    sound = images is not None and all(np.isfinite(each).all() for each in images.values())
    return "" if sound else "accepted an image that is not finite"


def _queue_example(_config: Config) -> bytes:
    return queue_file.content(3).encode()


def _read_queue(path: Path, _config: Config) -> str:
    kept = queue_file.read(path)
    if kept.count is not None and not 0 <= kept.count <= 99:
        return f"count out of range: {kept.count}"
    return "a warning of several lines" if "\n" in kept.warning else ""


def _seen_example(_config: Config) -> bytes:
    entries = [["follower/request/dock", f"station-{n}", n, 10 * n] for n in range(8)]
    return (json.dumps({"schema": "requests_seen/1", "seen": entries}) + "\n").encode()


def _read_seen(path: Path, _config: Config) -> str:
    desk = RequestDesk("boot", lambda _channel, answer: answer.id.encode())
    desk.restore(read_text(path))
    desk.restore(desk.content())
    desk.settle(Answer("x", "done", ""), b"")
    return ""


PROCESS_KINDS = (
    FileKind(
        name="configuration",
        file_name="robots.toml",
        form="toml",
        example=_config_example,
        read=_read_config,
        refuses=(ConfigError,),
    ),
    FileKind(
        name="override",
        file_name="override.txt",
        form="override",
        example=_override_example,
        read=_read_override,
        refuses=(ConfigError,),
    ),
    FileKind(
        name="calibration",
        file_name="lens.toml",
        form="toml",
        example=_calibration_example,
        read=_read_calibration,
        refuses=(ConfigError,),
    ),
    FileKind(
        name="object dictionary",
        file_name="drive.eds",
        form="toml",
        example=_dictionary_example,
        read=_read_dictionary,
        refuses=(ConfigError,),
    ),
    FileKind(
        name="taught image",
        file_name=taught_name(1),
        form="json",
        example=_taught_example,
        read=_read_taught,
        refuses=(ConfigError,),
    ),
    FileKind(name="queue", file_name="queue.json", form="json", example=_queue_example, read=_read_queue),
    FileKind(
        name="requests seen",
        file_name="requests-leader.json",
        form="json",
        example=_seen_example,
        read=_read_seen,
        refuses=(UnreadableError,),
    ),
)
