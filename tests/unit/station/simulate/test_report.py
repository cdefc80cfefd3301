"""What `davpc sim` prints at the end of a queue: a row for each trolley, and whether memory is flat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from station.simulate.report import print_results


def collection(end_mb: float) -> dict[str, Any]:
    def row(trolley: int, cause: str) -> dict[str, Any]:
        metrics = {"e_x_cm": 0.1, "e_y_cm": 0.25, "e_theta_deg": 0.125, "e_p_px": 1.0, "duration_s": 31.5}
        return {
            "trolley": trolley, "connected": cause == "docked", "cause": cause, "metrics": metrics,
            "image_to_can_ms": {"p50": 20.0, "p99": 33.5},
        }  # fmt: skip

    return {
        "connected": False,
        "cause": "leds_lost: 3 searches",
        "trolleys": [row(1, "docked"), row(2, "leds_lost: 3 searches")],
        "memory_mb": {"world": {"quarter": 90.0, "end": 91.0}, "follower-camera": {"quarter": 80.0, "end": end_mb}},
        "settings": {"trolleys": 3},
    }


@pytest.mark.parametrize(
    ("end_mb", "said"),
    [
        (84.0, "memory is flat: no process grew by more than 5 MB"),
        (96.0, "memory is not flat: more than 5 MB in follower-camera"),
    ],
)
def test_a_queue_is_a_row_a_trolley_and_shows_flat_memory(tmp_path: Path, end_mb: float, said: str) -> None:
    path = tmp_path / "said.txt"
    with path.open("w") as file:
        print_results(collection(end_mb), Console(file=file, width=200))
    lines = path.read_text().splitlines()
    assert "1 of 3 trolleys docked and locked: leds_lost: 3 searches" in lines[0]
    rows = [line for line in lines if "0.250" in line]
    assert ["locked" in row for row in rows] == [True, False]
    assert "leds_lost" in rows[1]
    assert lines[-1] == said
