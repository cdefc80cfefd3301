"""One self-contained page of a docking, or of two side by side."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from common.messages import DockingState
from common.recording.pictures import pixels
from station.operate.attempts import Record, biases
from station.report import figures
from station.report.attempt import RecordedAttempt
from station.report.explanation import evidence, headline

_WIDTH_PX = 560
_MOST_EVENTS = 60


def page(attempt: RecordedAttempt, against: RecordedAttempt | None, others: Sequence[Record]) -> str:
    """The page as HTML.

    Args:
        attempt: the docking.
        against: another to compare it with.
        others: the attempts before it, oldest first.
    """
    labelled = [(_name(each), each) for each in (attempt, against) if each is not None]
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    shown = None
    if others:
        shown = {"count": len(others), "figure": figures.beside_others(others, attempt)}
        shown["warnings"] = biases(list(others))
    text: str = environment.get_template("page.html.j2").render(
        title=f"Docking {_name(attempt)}",
        parts=[_part(name if against is not None else "", each) for name, each in labelled],
        table=_table(labelled) if against is not None else None,
        time_series=figures.time_series(labelled),
        plan_view=figures.plan_view(labelled),
        image_view=figures.image_view(labelled),
        others=shown,
    )
    return text


def _name(attempt: RecordedAttempt) -> str:
    path = attempt.recording.path
    return path.stem if path.stem != "run" else f"{path.parent.name}/{path.stem}"


def _part(name: str, attempt: RecordedAttempt) -> dict[str, Any]:
    about = attempt.recording.about
    facts = {"source": "", "scene": "scene ", "seed": "seed ", "began": "began ", "host": "on ", "davpc": "davpc "}
    shown = [f"{prefix}{about[key]}" for key, prefix in facts.items() if key in about]
    first, *lines = headline(attempt)
    return {
        "heading": f"{name}: {first}" if name else first,
        "of": f": {name}" if name else "",
        "docked": attempt.docked,
        "about": f"Trolley {attempt.trolley}, method {attempt.config.controller.method}; {', '.join(shown)}",
        "lines": [*lines, *_losses(attempt)],
        "evidence": evidence(attempt),
        "pictures": _pictures(attempt),
        "events": [(f"{attempt.seconds(e.time_ns):.2f}", e.text) for e in attempt.events[-_MOST_EVENTS:]],
    }


def _losses(attempt: RecordedAttempt) -> list[str]:
    recording = attempt.recording
    lines = [f"The file ends too early: {recording.torn}."] if recording.torn else []
    return lines + [f"The recorder dropped {count} of {name}." for name, count in recording.dropped.items()]


def summary_rows(attempt: RecordedAttempt) -> list[tuple[str, str]]:
    """The figures of a docking."""
    error = attempt.error
    drives = attempt.within(attempt.drives)
    more = drives[-1][1].gate_interventions - drives[0][1].gate_interventions if drives else 0
    rows = [
        ("lateral error, estimated", "–" if error is None else f"{100 * error.e_y_m:+.2f} cm"),
        ("heading error, estimated", "–" if error is None else f"{error.e_theta_deg:+.2f}°"),
        ("duration", f"{attempt.seconds(attempt.end_ns):.1f} s"),
        ("pauses", str(sum(event.kind == "pause" for event in attempt.events))),
        ("interventions of the gate", str(more)),
    ]
    return rows + [(f"phase {phase}", f"{(end - begin) / 1e9:.1f} s") for phase, begin, end in attempt.phases]


def _table(labelled: figures.Labelled) -> dict[str, Any]:
    tables = [dict(reversed(summary_rows(attempt))) for _, attempt in labelled]
    labels = list(dict.fromkeys(label for _, attempt in labelled for label, _ in summary_rows(attempt)))
    rows = [[label, *(table.get(label, "–") for table in tables)] for label in labels]
    return {"names": [name for name, _ in labelled], "rows": rows}


def _pictures(attempt: RecordedAttempt) -> list[dict[str, str]]:
    shown = []
    for moment, time_ns in attempt.key_moments:
        found = attempt.picture(time_ns)
        if found is None:
            continue
        capture_ns, data = found
        picture = _drawn(attempt, data, attempt.state_of(capture_ns))
        caption = f"{moment}, taken at {attempt.seconds(capture_ns):.1f} s"
        shown.append({"caption": caption, "data": base64.b64encode(picture).decode("ascii")})
    return shown


def _drawn(attempt: RecordedAttempt, data: bytes, state: DockingState | None) -> bytes:
    """The picture, smaller, with the features that the estimator measured and predicted in it."""
    canvas = cv2.cvtColor(pixels(data), cv2.COLOR_GRAY2BGR)
    pinhole = attempt.config.camera.pinhole
    if state is not None:
        for feature in state.features:
            if feature is not None:
                u, v = pinhole.to_pixels(np.array(feature))
                cv2.circle(canvas, (round(float(u)), round(float(v))), 18, (80, 255, 80), 3, cv2.LINE_AA)
        for predicted in state.features_filtered:
            u, v = pinhole.to_pixels(np.array(predicted))
            cv2.drawMarker(
                canvas, (round(float(u)), round(float(v))), (0, 200, 255), cv2.MARKER_CROSS, 26, 2, cv2.LINE_AA
            )
    height = round(canvas.shape[0] * _WIDTH_PX / canvas.shape[1])
    small = cv2.resize(canvas, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, 80))[1].tobytes()
