"""Figures of one docking, or of two on one another, as SVG that follows the page's colours."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np

from common.geometry import Pose2, features_at
from common.recording.recording import Recording
from common.recording.run import WORLD_KEY
from common.recording.views import unpacked
from common.timing import NS_PER_MS
from station.operate.attempts import Record
from station.report.attempt import RecordedAttempt

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_INK = "#123456"  # replaced by the colour of the page's text
_COLOURS = ("#3987e5", "#d95926")
_SOFT = ("#8fbdf2", "#f0a884")
_BANDS = ("#88888818", "#88888830")
_STYLE: Any = {
    "svg.fonttype": "none",
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "grid.color": "#88888850",
    "font.size": 9,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "davpc",
}
Labelled = Sequence[tuple[str, RecordedAttempt]]


def time_series(attempts: Labelled) -> str:
    """Heading, disturbances, commands and what the gate made of them, ages, over the time of the docking."""
    rows: list[tuple[str, Callable[[Axes, str, RecordedAttempt, int], None]]] = [
        ("θ [°]", _heading),
        ("lateral [cm]", _lateral),
        ("disturbance", _disturbance),
        ("v [m/s]", _speed),
        ("ω [rad/s]", _turn_rate),
        ("age [ms]", _ages),
    ]
    with mpl.rc_context(_STYLE):
        figure, axes = plt.subplots(len(rows), 1, figsize=(9.2, 1.75 * len(rows)), sharex=True, layout="constrained")
        for axis, (label, draw) in zip(axes, rows, strict=True):
            for number, (name, attempt) in enumerate(attempts):
                draw(axis, f"{name} " if len(attempts) > 1 else "", attempt, number)
            axis.set_ylabel(label)
            axis.grid(lw=0.6)
            axis.legend(fontsize=7, ncols=4, loc="upper right")
        _phases(axes, attempts[0][1])
        axes[-1].set_xlabel("time since the docking began [s]")
        return _svg(figure)


def plan_view(attempts: Labelled) -> str:
    """The Follower's path in {L}, as estimated, and as it was where a simulated world is in the recording."""
    with mpl.rc_context(_STYLE):
        figure, axes = plt.subplots(figsize=(9.2, 3.4), layout="constrained")
        for number, (name, attempt) in enumerate(attempts):
            truth = np.array(_truth(attempt.recording)).reshape(-1, 2)
            if len(truth):
                axes.plot(truth[:, 0], truth[:, 1], color=_SOFT[number], lw=4, label=f"{name} true")
            states = [state for _, state in attempt.within(attempt.states) if state.valid]
            poses = [Pose2(state.x_m, state.y_m, state.theta_rad).inverse() for state in states]
            xs, ys = [pose.x_m for pose in poses], [pose.y_m for pose in poses]
            axes.plot(xs, ys, color=_COLOURS[number], lw=1.4, label=f"{name} estimated")
        goal = attempts[0][1].config.docking.goal(attempts[0][1].trolley).inverse()
        leds = attempts[0][1].config.leds.points
        axes.plot(goal.x_m, goal.y_m, "+", color=_INK, ms=12, label="goal")
        axes.plot(leds[:, 0], leds[:, 1], "*", color="#c98500", ms=8, label="LEDs")
        axes.set(xlabel="x in {L} [m]", ylabel="y in {L} [m]", aspect="equal")
        axes.grid(lw=0.6)
        axes.legend(fontsize=8, ncols=3)
        return _svg(figure)


def image_view(attempts: Labelled) -> str:
    """The features' way through the image, to where they are to be at the goal."""
    attempt = attempts[0][1]
    camera, pinhole = attempt.config.camera, attempt.config.camera.pinhole
    with mpl.rc_context(_STYLE):
        figure, axes = plt.subplots(figsize=(4.6, 3.8), layout="constrained")
        for number, (_, each) in enumerate(attempts):
            seen = [f for _, state in each.within(each.states) for f in state.features if f is not None]
            if seen:
                pixels = pinhole.to_pixels(np.array(seen))
                axes.plot(pixels[:, 0], pixels[:, 1], ".", ms=2, color=_COLOURS[number])
        goal = features_at(attempt.config.leds.points, attempt.config.docking.goal(attempt.trolley), camera.mount)
        wanted = pinhole.to_pixels(goal)
        axes.plot(wanted[:, 0], wanted[:, 1], "+", color=_INK, ms=12)
        axes.set(
            xlim=(0, camera.width_px), ylim=(camera.height_px, 0), aspect="equal", xlabel="u [px]", ylabel="v [px]"
        )
        axes.grid(lw=0.6)
        return _svg(figure)


def beside_others(records: Sequence[Record], attempt: RecordedAttempt) -> str:
    """Lateral and heading error and duration of the last attempts, this one marked at the right."""
    error = attempt.error
    rows = (
        ("lateral [cm]", [r.arrival.e_y_cm if r.arrival else math.nan for r in records], error and 100 * error.e_y_m),
        (
            "heading [°]",
            [r.arrival.e_theta_deg if r.arrival else math.nan for r in records],
            error and error.e_theta_deg,
        ),
        ("time [s]", [r.duration_s for r in records], attempt.seconds(attempt.end_ns)),
    )
    with mpl.rc_context(_STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(9.2, 2.3), layout="constrained")
        for axis, (label, values, this) in zip(axes, rows, strict=True):
            axis.plot(range(-len(values), 0), values, "o-", ms=4, lw=1, color=_SOFT[0])
            if this is not None:
                axis.plot([0], [this], "D", ms=7, color=_COLOURS[1])
            axis.set(ylabel=label, xlabel="attempts before this one")
            axis.grid(lw=0.6)
        return _svg(figure)


def _heading(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    states = attempt.within(attempt.states)
    time_s = [attempt.seconds(time_ns) for time_ns, _ in states]
    fits = [math.degrees(state.fit[2]) if state.fit is not None else math.nan for _, state in states]
    axis.plot(time_s, fits, ".", ms=2, color=_SOFT[number], label=f"{name}measured")
    filtered = [math.degrees(state.theta_rad) if state.valid else math.nan for _, state in states]
    axis.plot(time_s, filtered, lw=1.3, color=_COLOURS[number], label=f"{name}estimated")


def _lateral(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    states = attempt.within(attempt.states)
    values = [
        100 * Pose2(state.x_m, state.y_m, state.theta_rad).inverse().y_m if state.valid else math.nan
        for _, state in states
    ]
    axis.plot(
        [attempt.seconds(time_ns) for time_ns, _ in states],
        values,
        lw=1.3,
        color=_COLOURS[number],
        label=f"{name}lateral",
    )


def _disturbance(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    states = attempt.within(attempt.states)
    time_s = [attempt.seconds(time_ns) for time_ns, _ in states]
    labels = ("speed gain", "turn gain", "yaw [rad/s]", "sideways [m/s]")
    for index, (label, style) in enumerate(zip(labels, ("-", "--", ":", "-."), strict=True)):
        values = [state.disturbance[index] if state.valid else math.nan for _, state in states]
        axis.plot(time_s, values, style, lw=1.1, color=_COLOURS[number], label=f"{name}{label}")


def _speed(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    _twist(axis, name, attempt, number, "v_m_s", "v_set_m_s")


def _turn_rate(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    _twist(axis, name, attempt, number, "w_rad_s", "w_set_rad_s")


def _twist(axis: Axes, name: str, attempt: RecordedAttempt, number: int, wanted: str, sent: str) -> None:
    commands, drives = attempt.within(attempt.commands), attempt.within(attempt.drives)
    at_s = [attempt.seconds(time_ns) for time_ns, _ in commands]
    values = [getattr(command, wanted) for _, command in commands]
    axis.step(at_s, values, where="post", lw=2.4, color=_SOFT[number], label=f"{name}commanded")
    at_s = [attempt.seconds(time_ns) for time_ns, _ in drives]
    values = [getattr(each, sent) for _, each in drives]
    axis.step(at_s, values, where="post", lw=1.0, color=_COLOURS[number], label=f"{name}after the gate")


def _ages(axis: Axes, name: str, attempt: RecordedAttempt, number: int) -> None:
    states, drives = attempt.within(attempt.states), attempt.within(attempt.drives)
    ages = [(time_ns - state.capture_ns) / NS_PER_MS for time_ns, state in states]
    axis.plot(
        [attempt.seconds(t) for t, _ in states], ages, ".", ms=2, color=_SOFT[number], label=f"{name}image → state"
    )
    to_can = [each.image_to_can_ns / NS_PER_MS for _, each in drives]
    axis.plot(
        [attempt.seconds(t) for t, _ in drives], to_can, lw=1, color=_COLOURS[number], label=f"{name}image → CAN"
    )


def _phases(axes: Sequence[Axes], attempt: RecordedAttempt) -> None:
    """Bands for the phases, with their names above; thin lines where something happened."""
    for number, (phase, begin_ns, end_ns) in enumerate(attempt.phases):
        begin_s, end_s = attempt.seconds(begin_ns), attempt.seconds(end_ns)
        for axis in axes:
            axis.axvspan(begin_s, end_s, color=_BANDS[number % 2], lw=0, zorder=-5)
        if end_s - begin_s > 0.02 * attempt.seconds(attempt.end_ns):
            axes[0].text(
                begin_s, 1.02, phase, transform=axes[0].get_xaxis_transform(), fontsize=7, rotation=25, va="bottom"
            )
    for event in attempt.events:
        if event.kind in ("pause", "end"):
            for axis in axes:
                axis.axvline(attempt.seconds(event.time_ns), color="#e34948", lw=0.9, ls="--")


def _truth(recording: Recording) -> list[tuple[float, float]]:
    """The true path [m] of the Follower in {L}, where a simulated world was recorded."""
    worlds = (unpacked(record.data) for record in recording.topics.get(WORLD_KEY, ()))
    bodies = [world[1] for world in worlds if world is not None]
    return [(body["x_m"], body["y_m"]) for body in bodies if {"x_m", "y_m"} <= body.keys()]


def _svg(figure: Figure) -> str:
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    plt.close(figure)
    text = stream.getvalue()
    return text[text.index("<svg") :].replace(_INK, "currentColor")
