"""Figures of the collection experiments: errors by trolley, and the scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from common.geometry import Pose2
from experiments.queues.run import Docking, DockingTrace
from sim.optics.image import Optics, View
from sim.optics.scenes import named_scene

_BLUE, _RED, _GREEN, _ORANGE = "#0072b2", "#d55e00", "#009e73", "#e69f00"
_SNAPSHOTS = (0.0, 0.5, 1.0)


def _canvas(rows: int, columns: int, size_in: tuple[float, float]) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def draw_sequential(
    queues: list[list[Docking]], image_bounds: list[tuple[float, float]], config: Config, path: Path
) -> None:
    """The paper's figure of errors: e_y and e_θ by trolley, every docking, mean, bound, and what the image allows.

    Args:
        queues: dockings of each queue.
        image_bounds: (e_y [cm], e_θ [°]) that the image allows, by trolley.
        config: the robots.
        path: file to write.
    """
    figure, axes = _canvas(2, 1, (9, 7))
    numbers = np.arange(1, len(image_bounds) + 1)
    names = (("e_y_cm", "e_y [cm]"), ("e_theta_deg", "e_θ [°]"))
    for axis, (name, label), column in zip(axes[:, 0], names, (0, 1), strict=True):
        values = [[d.metrics[name] for q in queues for d in q if d.trolley == k and d.metrics] for k in numbers]
        for k, errors in zip(numbers, values, strict=True):
            axis.plot([k] * len(errors), errors, ".", color="0.6", ms=5)
        means = [float(np.mean(errors)) if errors else np.nan for errors in values]
        axis.plot(numbers, means, "o-", color=_BLUE, label="mean")
        limits = [bound[column] for bound in image_bounds]
        axis.plot(numbers, limits, "--", color=_GREEN, label="what the smaller image allows (Cramér–Rao)")
        axis.set(xlabel="trolley", ylabel=label, xticks=numbers)
        axis.grid(alpha=0.3)
    docking = config.docking
    bounds = [docking.lateral_bound_first_m if k == 1 else docking.lateral_bound_next_m for k in numbers]
    axes[0, 0].step(numbers, 100 * np.array(bounds), where="mid", color=_RED, label="bound")
    axes[0, 0].set_yscale("log")
    for axis in axes[:, 0]:
        axis.legend(fontsize=8)
    figure.savefig(path)


def draw_scenarios(shown: dict[str, tuple[dict[str, Any], Docking]], config: Config, out: Path) -> None:
    """The paper's figure of its experiments: by scenario three snapshots, θ measured and estimated, u_F over time."""
    columns = len(_SNAPSHOTS) + 2
    figure, axes = _canvas(len(shown), columns, (4 * columns, 3.4 * len(shown)))
    for cells, (name, (changes, docking)) in zip(axes, shown.items(), strict=True):
        trace = docking.trace
        if trace is None or not trace.time_s:
            continue
        for cell, share in zip(cells, _SNAPSHOTS, strict=False):
            row = min(int(share * _approach_rows(docking)), len(trace.time_s) - 1)
            cell.imshow(snapshot(config, changes, trace.pose[row], row), cmap="gray", vmin=0, vmax=120)
            cell.set(title=f"{name}, t = {trace.time_s[row] - trace.time_s[0]:.0f} s", xticks=[], yticks=[])
        _draw_series(trace, cells[-2], cells[-1])
    figure.savefig(out / "scenarios.png")


def _approach_rows(docking: Docking) -> int:
    """Rows of the trace up to the end of the approach."""
    trace = docking.trace
    assert trace is not None
    end_s = next((start for phase, start in docking.phases_s if phase == "insert"), trace.time_s[-1])
    return int(np.searchsorted(trace.time_s, end_s))


def snapshot(config: Config, changes: dict[str, Any], pose: tuple[float, float, float], number: int) -> Any:
    """The camera's image (h, w) in a scenario.

    Args:
        config: the robots.
        changes: to ``[world]``: scene and seed.
        pose: of {F} in {L}: x [m], y [m], θ [rad].
        number: of the frame, which gives the time in the scene.
    """
    camera = config.camera
    image = np.zeros((camera.height_px, camera.width_px), np.uint8)
    scene = named_scene(changes["scene"], changes["seed"])
    time_ns = round(number / camera.rate_hz * 1e9)
    currents = (config.leds.current_a,) * len(config.leds.points)
    view = View(number + 1, Pose2(*pose).inverse(), currents, time_ns=time_ns, scene=scene)
    Optics(camera, config.leds, changes["seed"]).render(image, view)
    return image


def _draw_series(trace: DockingTrace, heading: Any, output: Any) -> None:
    seconds = np.array(trace.time_s) - trace.time_s[0]
    if np.isfinite(trace.theta_homography).any():  # the paper's methods alone measure it
        heading.plot(seconds, np.degrees(trace.theta_homography), ".", ms=1.5, color="0.6", label="θ homography")
    heading.plot(seconds, np.degrees(trace.theta_estimated), color=_BLUE, label="θ estimated")
    heading.plot(seconds, np.degrees(trace.theta_true), "k--", lw=0.8, label="θ true")
    output.plot(seconds, trace.v_m_s, color=_BLUE, label="v [m/s]")
    output.plot(seconds, trace.w_rad_s, color=_ORANGE, label="ω [rad/s]")
    spread = np.degrees(np.nanmax(np.abs(trace.theta_true))) + 10.0
    heading.set(xlabel="t [s]", ylabel="θ_L^F [°]", ylim=(-spread, spread))
    output.set(xlabel="t [s]", ylabel="u_F")
    for axis in (heading, output):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
