"""Figures of the experiments, as PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from common.geometry import Array
from experiments.feature_level.feature_world import Pads
from experiments.feature_level.trial import FlightTrace

COLOURS = {
    "ibvs": "#d55e00",
    "ke": "#009e73",
    "pose_based": "#cc79a7",
    "vpc": "#e69f00",
    "paper": "#56b4e9",
    "davpc": "#0072b2",
}
STYLES = ("-", "--", "-.", ":")


def _canvas(rows: int, columns: int, size_in: tuple[float, float]) -> tuple[Any, Any]:
    """A figure and its axes (rows, columns), without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def draw_trajectories(traces: dict[str, list[FlightTrace]], config: Config, path: Path) -> None:
    """Plan view of every start; θ(t) and features of the first: as the paper's figure of its trajectories."""
    figure, axes = _canvas(2, 2, (11, 8))
    plan, heading, image, error = axes.ravel()
    for method, runs in traces.items():
        for i, trace in enumerate(runs):
            rows = trace.arrays()
            label = method if i == 0 else None
            plan.plot(-rows["pose"][:, 0], rows["pose"][:, 1], STYLES[i % 4], color=COLOURS[method], label=label)
        rows = runs[0].arrays()
        heading.plot(rows["time_s"], -np.degrees(rows["pose"][:, 2]), color=COLOURS[method], label=method)
        for point in range(rows["features"].shape[1]):
            track = rows["features"][:, point]
            image.plot(track[:, 0], track[:, 1], color=COLOURS[method], lw=1)
        misfit = np.sqrt(np.mean(np.sum((rows["features"] - rows["features"][-1]) ** 2, axis=2), axis=1))
        error.semilogy(rows["time_s"], np.maximum(misfit, 1e-2), color=COLOURS[method], label=method)
    goal = config.docking.goal(1).x_m
    plan.plot([goal], [0.0], "k*", ms=11, label="goal")
    plan.invert_xaxis()
    plan.set(xlabel="distance behind the Leader [m]", ylabel="y [m]", title="plan view, one line style a start")
    heading.set(xlabel="t [s]", ylabel="θ_L^F [°]", title="heading, first start")
    image.set(xlabel="u [px]", ylabel="v [px]", aspect="equal", title="features in the image, first start")
    image.invert_yaxis()
    error.set(xlabel="t [s]", ylabel="px", title="features, RMS distance to where they end")
    for axis in (plan, heading, error):
        axis.grid(alpha=0.3)
        axis.legend()
    figure.savefig(path)


def draw_disturbed_runs(traces: dict[str, FlightTrace], pads: tuple[Pads, ...], path: Path) -> None:
    """As the paper's figure of its observer: plan view over the pads, estimated disturbance, compensation."""
    figure, axes = _canvas(3, 1, (10, 11))
    plan, estimate, output = axes[:, 0]
    for method, trace in traces.items():
        rows = trace.arrays()
        end = abs(100 * rows["pose"][-1, 1])
        plan.plot(
            -rows["pose"][:, 0], rows["pose"][:, 1], color=COLOURS[method], label=f"{method}: e_y = {end:.2f} cm"
        )
    for i, pad in enumerate(pads):
        plan.axvspan(pad.from_m, pad.to_m, color="0.85", zorder=0, label="pads" if i == 0 else None)
    plan.invert_xaxis()
    plan.set(xlabel="distance behind the Leader [m]", ylabel="y [m]", title="rubber pads on the path")
    _draw_estimates(traces, pads, estimate, output)
    for axis in (plan, estimate, output):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, ncols=2)
    figure.savefig(path)


def _draw_estimates(traces: dict[str, FlightTrace], pads: tuple[Pads, ...], estimate: Any, output: Any) -> None:
    for method, trace in traces.items():
        rows = trace.arrays()
        if method == "paper":
            estimate.plot(
                rows["time_s"], rows["disturbance"][:, -1], color=COLOURS[method], label="paper: d̂_θ [rad/s]"
            )
            largest = np.abs(rows["disturbance"][:, :-1]).max(axis=1)
            estimate.plot(rows["time_s"], largest, ":", color=COLOURS[method], label="paper: largest |d̂_s| [1/s]")
            output.plot(
                rows["time_s"], rows["compensation"][:, 0], color=COLOURS[method], label="paper: u_C, v [m/s]"
            )
            output.plot(
                rows["time_s"], rows["compensation"][:, 1], "--", color=COLOURS[method], label="u_C, ω [rad/s]"
            )
        if method == "davpc":
            for i, name in ((2, "yaw [rad/s]"), (3, "sideways [m/s]")):
                style = STYLES[i - 2]
                estimate.plot(
                    rows["time_s"], rows["disturbance"][:, i], style, color=COLOURS[method], label=f"davpc: {name}"
                )
            for axis in (estimate, output):
                _shade_phases(rows, pads, axis)
    estimate.set(xlabel="t [s]", ylabel="d̂", title="estimated disturbance: before, over and behind the pads")
    output.set(xlabel="t [s]", ylabel="u_C", title="compensation")


def _shade_phases(rows: dict[str, Array], pads: tuple[Pads, ...], axis: Any) -> None:
    """The paper's three phases in its colours: before, over, and behind the pads."""
    distance, time = -rows["pose"][:, 0], rows["time_s"]
    over = time[np.any([(distance >= pad.from_m) & (distance <= pad.to_m) for pad in pads], axis=0)]
    if not over.size:
        return
    edges = (time[0], over[0], over[-1], time[-1])
    phases = (("before the pads", "#d6e6f5"), ("over the pads", "#fff0b8"), ("behind the pads", "#f8d6d6"))
    for (name, colour), begin, end in zip(phases, edges[:-1], edges[1:], strict=True):
        axis.axvspan(begin, end, color=colour, zorder=0, label=f"{name} (davpc)")


def draw_sweep(rows: list[dict[str, Any]], path: Path) -> None:
    """e_y, M_ω and solve time against N_p; e_y and M_ω against ω_o."""
    figure, axes = _canvas(2, 3, (13, 7))
    for column, metric, label in ((0, "e_y_cm", "e_y [cm]"), (1, "m_w", "M_ω"), (2, "solve_ms", "median solve [ms]")):
        axis = axes[0, column]
        for method in ("paper", "davpc"):
            chosen = _series(rows, method, "horizon_", metric)
            axis.plot(*chosen, "o-", color=COLOURS[method], label=method)
        axis.set(xlabel="N_p", ylabel=label, yscale="log")
        axis.legend()
    for column, metric, label in ((0, "e_y_cm", "e_y [cm]"), (1, "m_w", "M_ω"), (2, "e_theta_deg", "e_θ [°]")):
        axis = axes[1, column]
        axis.semilogx(*_series(rows, "paper", "bandwidth_", metric), "o-", color=COLOURS["paper"], label="yaw pads")
        axis.set(xlabel="ω_o [rad/s]", ylabel=label)
        axis.legend()
    for axis in axes.ravel():
        axis.grid(alpha=0.3, which="both")
    figure.savefig(path)


def _series(rows: list[dict[str, Any]], method: str, prefix: str, metric: str) -> tuple[list[float], list[float]]:
    chosen = [row for row in rows if row["method"] == method and row["case"].startswith(prefix)]
    return [float(row["case"].removeprefix(prefix)) for row in chosen], [row["metrics"][metric] for row in chosen]
