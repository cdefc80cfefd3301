"""What a millimetre here costs there: docked errors of one small error at a time, linearised and docked.

Linearised: a docking ends where the pose fitted to the image is the goal. With h the image by pose and tilt of the
robot, e the error, and P the fit's gain (pose rows of (HᵀH/σ² + prior)⁻¹Hᵀ/σ²), that pose is off by −(P ∂h/∂pose)⁻¹ P
∂h/∂e. The derivatives by e are of the world's optics, those by the pose of the estimator's model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.docking_errors import DockingError, docked_error
from common.geometry import Array, Pose2
from experiments.tolerance.robots import RobotJob
from experiments.tolerance.world import TrueRobot
from follower.estimator.pipeline import TILT_SIGMA_RAD
from follower.model.array import LedArray, led_by_led
from sim.truth import Truth
from sim.world_config import world_config

COLUMNS = ("e_x_cm", "e_y_cm", "e_theta_deg")


@dataclass(frozen=True)
class UnitError:
    """One error: its name with the unit that the table counts in, and the truth with that much of it, or more."""

    name: str
    truth: Truth
    units: float = 1.0

    @property
    def opposite(self) -> Truth:
        """The same to the other side."""
        values = {name: _negated(getattr(self.truth, name)) for name in self.truth.model_fields_set}
        return Truth.model_validate(values)


def _negated(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(_negated(part) for part in value)
    assert isinstance(value, float)
    return -value


def unit_errors(config: Config) -> Iterator[UnitError]:
    """Camera 1 mm and .1° along each axis, focal length .1 %, centre 1 px, each LED 1 mm, the Leader's stand.

    Docked with three times as much, so that the noise of a docking does not hide them.
    """
    for axis, name in enumerate("xyz"):
        yield UnitError(f"camera {name} 1 mm", Truth(camera_m=_along(axis, 0.003)), 3.0)
    for axis, name in enumerate(("pitch", "roll", "yaw")):
        yield UnitError(f"camera {name} 0.1°", Truth(camera_tilt_deg=_along(axis, 0.3)), 3.0)
    yield UnitError("focal length 0.1 %", Truth(focal=0.003), 3.0)
    yield UnitError("image centre u 1 px", Truth(centre_px=(3.0, 0.0)), 3.0)
    yield UnitError("image centre v 1 px", Truth(centre_px=(0.0, 3.0)), 3.0)
    for led in range(len(config.leds.points)):
        for axis, name in enumerate("XYZ"):
            rows = [(0.0, 0.0, 0.0)] * len(config.leds.points)
            rows[led] = _along(axis, 0.003)
            yield UnitError(f"LED {led} {name} 1 mm", Truth(leds_m=tuple(rows)), 3.0)
    yield UnitError("Leader pitch 0.1°", Truth(leader_tilt_deg=(0.3, 0.0)), 3.0)
    yield UnitError("Leader roll 0.1°", Truth(leader_tilt_deg=(0.0, 0.3)), 3.0)


def _along(axis: int, size: float) -> tuple[float, float, float]:
    x, y, z = (size if place == axis else 0.0 for place in range(3))
    return x, y, z


def linearised(config: Config, error: UnitError) -> dict[str, float]:
    """Signed docked error for one unit of an error, to first order."""
    goal = config.docking.goal(1)
    slopes = _pixel_slopes(config, goal)
    information = slopes.T @ slopes / config.estimator.pixel_sigma_px**2
    information[3:, 3:] += np.eye(2) / TILT_SIGMA_RAD**2
    gain = np.linalg.solve(information, slopes.T)[:3] / config.estimator.pixel_sigma_px**2
    moved = (_pixels(config, error.truth) - _pixels(config, error.opposite)) / (2 * error.units)
    off = -np.linalg.solve(gain @ slopes[:, :3], gain @ moved)
    x, y, theta = (goal.as_array() + off).tolist()
    return signed(docked_error(Pose2(x, y, theta).inverse(), goal))


def signed(error: DockingError) -> dict[str, float]:
    """Signed errors by the names of the columns, in cm and degrees."""
    return dict(zip(COLUMNS, (100 * error.e_x_m, 100 * error.e_y_m, error.e_theta_deg), strict=True))


def _pixels(config: Config, truth: Truth) -> Array:
    """The true image at the first goal, (2n,)."""
    goal = config.docking.goal(1)
    robot = TrueRobot(config, world_config(config, "sensitivity"), truth, goal.inverse(), [0])
    return robot.seen_from(goal).reshape(-1)


def _pixel_slopes(config: Config, goal: Pose2) -> Array:
    """Of the modelled image by x, y, θ, pitch, roll, (2n, 5), through a lens whose distortion counts as constant."""
    state = np.append(goal.as_array(), (0.0, 0.0))
    _, slopes, _ = LedArray(config.leds.points, config.camera.mount).project(state[None])
    scaled: Array = (
        led_by_led(slopes[0])
        * np.tile([config.camera.lens.fx_px, config.camera.lens.fy_px], len(config.leds.points))[:, None]
    )
    return scaled


def jobs_of(config_text: str, error: UnitError, seed: int) -> list[RobotJob]:
    """Dockings to both sides of an error, from one start with one noise: half their difference is the error's."""
    return [RobotJob(config_text, "geometry", truth, seed=seed) for truth in (error.truth, error.opposite)]


def docked(error: UnitError, ends: list[dict[str, float]]) -> dict[str, float]:
    """Signed docked error for one unit, from both dockings."""
    there, opposite = ends
    return {name: (there[name] - opposite[name]) / (2 * error.units) for name in COLUMNS}


def table(rows: list[tuple[str, dict[str, float], dict[str, float] | None]]) -> str:
    """Markdown: each error with what it costs, linearised and docked."""
    lines = [
        "## What a millimetre here costs there",
        "",
        "Signed, for the error named; linearised, then docked (half the difference of two dockings, – not docked).",
        "",
        "| error | e_x cm | docked | e_y cm | docked | e_θ ° | docked |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, linear, found in rows:
        cells = []
        for column in COLUMNS:
            cells += [f"{linear[column]:+.3f}", "–" if found is None else f"{found[column]:+.3f}"]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
