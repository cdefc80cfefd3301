"""The files that commands read, for ``davpc experiment fuzz``: views for the mount, reports of attempts."""

from __future__ import annotations

import json
from pathlib import Path

from common.config import Config
from common.errors import ConfigError
from experiments.fuzz.files import FileKind
from station.calibrate.mount_file import load_views
from station.operate.attempts import read_attempts, summarise
from station.operate.format import report_lines

_ATTEMPTS = 8


def _mount_example(config: Config) -> bytes:
    features = [None, *([0.1, 0.2 + n / 100] for n in range(len(config.leds.points) - 1))]
    return json.dumps([{"pose": [2.0, 0.3, -n], "features": features} for n in range(4)], indent=1).encode()


def _read_mount(path: Path, config: Config) -> str:
    leds = len(config.leds.points)
    views = load_views(path, leds)
    return "" if all(view.features.shape == (leds, 2) for view in views) else "accepted a view of another array"


def _attempts_example(_config: Config) -> bytes:
    return b"".join(json.dumps(_attempt(n)).encode() + b"\n" for n in range(_ATTEMPTS))


def _attempt(number: int) -> dict[str, object]:
    error = {"e_x_cm": 0.1 * number, "e_y_cm": 0.2, "e_theta_deg": 0.1}
    docked = number != 3
    return {
        "schema": "attempt/1",
        "trolley": 1,
        "epoch": number,
        "method": "davpc",
        "docked": docked,
        "cause": "" if docked else "leds_lost: 2 of 4",
        "code": "" if docked else "leds_lost",
        "needs_reset": False,
        "duration_s": 30.5,
        "phases_s": {"approach": 21.0},
        "arrival": error if docked else None,
        "connected": error if docked else None,
        "margins": {"age_ms": 60.0, "field_of_view_px": 80.5},
        "gate": {"interventions": 1, "rules": {"tracking": 1}},
        "retries": 0,
        "searches": 0,
        "pauses": {"LEDs": 1},
        "rearmed": 0,
    }


def _read_attempts(path: Path, config: Config) -> str:
    """A line that is whole is read, whatever stands beside it."""
    whole = set(_attempts_example(config).split(b"\n")) - {b""}
    intact = sum(line in whole for line in path.read_bytes().split(b"\n"))
    records, unreadable = read_attempts(path, 20)
    report_lines(summarise(records, unreadable))
    return "a whole record is lost" if len(records) < min(intact, 20 - unreadable) else ""


STATION_KINDS = (
    FileKind(
        name="mount views",
        file_name="views.json",
        form="json",
        example=_mount_example,
        read=_read_mount,
        refuses=(ConfigError,),
    ),
    FileKind(
        name="attempts",
        file_name="attempts.jsonl",
        form="json lines",
        example=_attempts_example,
        read=_read_attempts,
    ),
)
