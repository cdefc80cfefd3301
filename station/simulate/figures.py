"""Pictures of a docking: plan view, θ and features over time, a camera frame with what the estimator saw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from common.geometry import Pose2
from common.messages import DockingState, Phase
from common.timing import NS_PER_S
from station.simulate.record import DockingRecord

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_PHASE_COLOURS: dict[Phase, str] = {
    "staging": "0.8",
    "acquire": "0.9",
    "search": "#fbf3c0",
    "approach": "white",
    "insert": "#fdeedd",
    "push": "#fde0c5",
    "lock": "#cfe8cf",
    "release": "#d5e3f5",
    "retract": "#e5d9f2",
}
_LED_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")


def draw_all(records: Sequence[DockingRecord], out: Path) -> list[Path]:
    """Write the pictures for which there is data; returns their paths. Of several dockings each has its own."""
    drawn = []
    for record in records:
        suffix = f"-{record.trolley}.png" if len(records) > 1 else ".png"
        if record.truth:
            drawn.append(draw_plan_view(record, out / f"trajectory{suffix}"))
        if record.states:
            drawn.append(draw_time_series(record, out / f"timeseries{suffix}"))
        if record.picture:
            drawn.append(draw_camera_frame(record, out / f"camera_frame{suffix}"))
    if len(records) > 1 and all(record.truth for record in records):
        drawn.append(draw_collection(records, out / "collection.png"))
    return drawn


def draw_collection(records: Sequence[DockingRecord], path: Path) -> Path:
    """All trajectories in one plan view; lateral and heading error of each docking beside its bound."""
    figure, (plan, lateral, heading) = plt.subplots(3, 1, figsize=(9, 9), layout="constrained")
    for record in records:
        poses = np.array([(sample.pose.x_m, sample.pose.y_m) for sample in record.truth])
        plan.plot(poses[:, 0], poses[:, 1], lw=1.2, label=f"trolley {record.trolley}")
    numbers = [record.trolley for record in records]
    errors = [record.errors() for record in records]
    lateral.semilogy(numbers, [error["e_y_cm"] for error in errors], "o-", color="tab:blue", label="e_y")
    lateral.step(numbers, [100 * record.bound_m for record in records], where="mid", color="tab:red", label="bound")
    heading.plot(numbers, [error["e_theta_deg"] for error in errors], "o-", color="tab:orange")
    plan.set(xlabel="x in {L} [m]", ylabel="y in {L} [m]", title="Plan view of every docking, true")
    lateral.set(xlabel="trolley", ylabel="e_y [cm]", xticks=numbers)
    heading.set(xlabel="trolley", ylabel="e_θ [°]", xticks=numbers)
    for axis in (plan, lateral, heading):
        axis.grid(alpha=0.3)
    plan.legend(fontsize=7, ncols=4)
    lateral.legend(fontsize=8)
    return _save(figure, path)


def draw_plan_view(record: DockingRecord, path: Path) -> Path:
    """True trajectory and the estimate in {L}, with the array, the goal and the robot along it."""
    figure, axes = plt.subplots(figsize=(9, 4.2), layout="constrained")
    xs = np.array([sample.pose.x_m for sample in record.truth])
    ys = np.array([sample.pose.y_m for sample in record.truth])
    headings = np.array([sample.pose.theta_rad for sample in record.truth])
    estimated = np.array([_follower_in_leader(state) for state in record.states if state.valid])
    if len(estimated):
        axes.plot(estimated[:, 0], estimated[:, 1], ".", ms=1.5, color="tab:orange", label="estimated")
    axes.plot(xs, ys, color="tab:blue", lw=1.8, label="true")
    every = max(1, len(xs) // 14)
    axes.quiver(
        xs[::every],
        ys[::every],
        np.cos(headings[::every]),
        np.sin(headings[::every]),
        color="tab:blue",
        width=0.003,
        scale=24,
    )
    goal = record.goal().inverse()
    axes.plot(goal.x_m, goal.y_m, "k+", ms=12, label="goal")
    for sample in (record.truth[0], record.truth[-1]):
        _draw_robot(axes, sample.pose)
    bound = record.bound_m
    axes.fill_between(
        [goal.x_m - 0.5, goal.x_m + 0.2], -bound, bound, color="tab:green", alpha=0.25, label=f"±{100 * bound:.0f} cm"
    )
    leds = record.config.leds.points
    axes.plot(leds[:, 0], leds[:, 1], "r*", ms=7, label="LEDs")
    axes.set(
        xlabel="x in {L} [m]", ylabel="y in {L} [m]", title="Plan view: Follower docks at the Leader", aspect="equal"
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize=8)
    return _save(figure, path)


def draw_time_series(record: DockingRecord, path: Path) -> Path:
    """θ, the features, and the velocities over time; phases as bands."""
    figure, axes = plt.subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
    origin_ns = record.states[0].capture_ns
    seconds = np.array([(state.capture_ns - origin_ns) / NS_PER_S for state in record.states])
    measured = [np.nan if s.theta_homography_rad is None else s.theta_homography_rad for s in record.states]
    if np.isfinite(measured).any():  # the paper's methods alone measure it
        axes[0].plot(seconds, np.degrees(np.array(measured)), ".", ms=2, color="0.6", label="θ homography")
    filtered = [s.theta_rad if s.valid else np.nan for s in record.states]
    axes[0].plot(seconds, np.degrees(np.array(filtered)), color="tab:blue", label="θ filtered")
    if record.truth:
        true_s = [(sample.time_ns - origin_ns) / NS_PER_S for sample in record.truth]
        axes[0].plot(true_s, [-np.degrees(s.pose.theta_rad) for s in record.truth], "k--", lw=0.8, label="θ true")
    axes[0].set(ylabel="θ_L^F [°]")
    _plot_features(record, axes[1], seconds)
    times = [(command.stamp_ns - origin_ns) / NS_PER_S for command in record.commands]
    axes[2].step(times, [command.v_m_s for command in record.commands], where="post", label="v [m/s]")
    axes[2].step(times, [command.w_rad_s for command in record.commands], where="post", label="ω [rad/s]")
    axes[2].set(ylabel="u_F commanded", xlabel="time [s]")
    for axis in axes:
        _shade_phases(record, axis, origin_ns)
        axis.grid(alpha=0.3)
        axis.legend(loc="upper right", fontsize=7, ncols=3)
    return _save(figure, path)


def draw_camera_frame(record: DockingRecord, path: Path) -> Path:
    """A real frame of the run: measured spots as circles, the filtered prediction as crosses, the goal dotted."""
    assert record.picture is not None
    image, state = record.picture
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    pinhole = record.config.camera.pinhole
    goal_pixels = record.pixels(record.goal())
    for n, pixel in enumerate(goal_pixels):
        cv2.circle(canvas, _corner(pixel), 4, (120, 120, 120), 1, cv2.LINE_AA)
        if n < len(state.features_filtered):
            predicted = pinhole.to_pixels(np.array(state.features_filtered[n]))
            cv2.drawMarker(canvas, _corner(predicted), (0, 200, 255), cv2.MARKER_CROSS, 22, 1, cv2.LINE_AA)
        feature = state.features[n] if n < len(state.features) else None
        if feature is not None:
            pixel = pinhole.to_pixels(np.array(feature))
            cv2.circle(canvas, _corner(pixel), 16, (80, 255, 80), 2, cv2.LINE_AA)
            at = (_corner(pixel)[0] + 20, _corner(pixel)[1] - 12)
            cv2.putText(canvas, f"LED {n}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (80, 255, 80), 1, cv2.LINE_AA)
    _add_insets(canvas, record, state)
    pose = f"x {state.x_m:.2f} m  y {state.y_m:+.3f} m  theta {np.degrees(state.theta_rad):+.2f} deg"
    text = f"frame {state.frame_sequence}  {pose}"
    cv2.putText(canvas, text, (16, 32), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 1, cv2.LINE_AA)
    if not cv2.imwrite(str(path), canvas):
        raise OSError(f"{path}: the picture could not be written")
    return path


def _add_insets(canvas: np.ndarray, record: DockingRecord, state: DockingState) -> None:
    """The pixels around each measured spot, magnified, along the lower edge."""
    half, scale, margin = 10, 9, 16
    side = (2 * half + 1) * scale
    pinhole = record.config.camera.pinhole
    assert record.picture is not None
    image = cv2.copyMakeBorder(record.picture[0], half, half, half, half, cv2.BORDER_CONSTANT)
    top = canvas.shape[0] - side - margin
    for n, feature in enumerate(state.features):
        if feature is None:
            continue
        pixel = pinhole.to_pixels(np.array(feature))
        column, row = _corner(pixel)
        patch = image[row : row + 2 * half + 1, column : column + 2 * half + 1]
        if patch.shape != (2 * half + 1, 2 * half + 1):
            continue
        large = cv2.resize(patch, (side, side), interpolation=cv2.INTER_NEAREST)
        left = margin + n * (side + margin)
        canvas[top : top + side, left : left + side] = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
        centre = (pixel - [column, row] + half + 0.5) * scale + [left, top]
        cv2.drawMarker(canvas, _corner(centre), (0, 0, 255), cv2.MARKER_CROSS, 26, 1, cv2.LINE_AA)
        cv2.rectangle(canvas, (left, top), (left + side, top + side), (80, 255, 80), 1)
        at = (left + 6, top + 20)
        cv2.putText(canvas, f"LED {n}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (80, 255, 80), 1, cv2.LINE_AA)


def _plot_features(record: DockingRecord, axes: Axes, seconds: np.ndarray) -> None:
    for n in range(len(record.config.leds.positions_m)):
        seen = [s.features[n] if n < len(s.features) else None for s in record.states]
        values = np.array([(np.nan, np.nan) if feature is None else feature for feature in seen])
        colour = _LED_COLOURS[n % len(_LED_COLOURS)]
        axes.plot(seconds, values[:, 0], color=colour, label=f"α{n}, β{n}")
        axes.plot(seconds, values[:, 1], color=colour, ls=":")
    axes.set(ylabel="features s [-]")


def _draw_robot(axes: Axes, pose: Pose2) -> None:
    """Outline of the chassis, for scale."""
    corners = [(-0.25, -0.25), (-0.25, 0.25), (0.30, 0.25), (0.30, -0.25), (-0.25, -0.25)]
    outline = [pose.compose(Pose2(x, y, 0.0)) for x, y in corners]
    axes.plot([p.x_m for p in outline], [p.y_m for p in outline], color="0.3", lw=1.0)


def _shade_phases(record: DockingRecord, axes: Axes, origin_ns: int) -> None:
    ends = [stamp for _, stamp in record.phases[1:]]
    for (phase, start_ns), end_ns in zip(record.phases, ends, strict=False):
        colour = _PHASE_COLOURS.get(phase)
        if colour is not None:
            axes.axvspan((start_ns - origin_ns) / NS_PER_S, (end_ns - origin_ns) / NS_PER_S, color=colour, zorder=-5)


def _follower_in_leader(state: DockingState) -> tuple[float, float]:
    c, s = np.cos(state.theta_rad), np.sin(state.theta_rad)
    return float(-c * state.x_m - s * state.y_m), float(s * state.x_m - c * state.y_m)


def _corner(pixel: np.ndarray) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
