"""Camera, LEDs, wheels and latency from recorded approaches: one robust least-squares fit of all images.

Unknown are the robot's errors and, for every image, pose and tilt. Pixels tie errors and states; the wheels tie each
image to the next; tolerances are the priors, and fix what no drive can show: the array as a whole in {L}. The normal
equations are block-tridiagonal but for the errors, which all images share; they are filled block by block. A point
weighs less the worse it fits (Huber), and the noise of the pixels is estimated from what is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Array
from follower.calibration.drive import Drive
from follower.calibration.model import STATE, TILT_RAD, KeyFrames, RobotModel, key_frames, moved

FEWEST_DRIVES = 3
_FEWEST_IMAGES = 20  # of one drive
_IMAGES = 45  # of each drive that enter the fit
_LEAST_EVERY_S = 0.1
_LEAST_APPROACH_M, _LEAST_SIDES_M, _LEAST_TURN_RAD = 1.5, 0.6, math.radians(15.0)
_HUBER = 2.5
_ITERATIONS = 25
_SETTLED = 1e-4  # largest step of an error, in standard deviations
_ROUNDS = 2  # of the pixels' noise
_LEAST_PX = 0.02
OBSERVABLE = 0.5  # share of its prior's standard deviation below which an error counts as determined by the drives


class CoverageError(Exception):
    """Drives from which a robot cannot be calibrated; one line that says how to drive."""


@dataclass(frozen=True)
class RobotCalibration:
    """What drives say of a robot.

    Attributes:
        config: with all errors taken out.
        names, units: of the errors.
        values: (p,) true minus configured, relative ones over the configured value.
        covariance: (p, p).
        prior_sigma: (p,) standard deviations before the drives.
        residual_px: standard deviation of one coordinate of a spot, as the fit leaves it.
        images: that entered the fit.
    """

    config: Config
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    prior_sigma: Array
    residual_px: float
    images: int

    @property
    def sigma(self) -> Array:
        """(p,) standard deviations."""
        found: Array = np.sqrt(np.diag(self.covariance))
        return found

    @property
    def observable(self) -> list[bool]:
        """Whether the drives determine each error; where not, it is as the tape says."""
        return [bool(left < OBSERVABLE * before) for left, before in zip(self.sigma, self.prior_sigma, strict=True)]


def calibrate_robot(drives: Sequence[Drive], config: Config) -> RobotCalibration:
    """Fit a robot to its drives.

    Args:
        drives: three or more, from different sides.
        config: the robots as they were configured in them.

    Raises:
        CoverageError: the drives are too few or too much alike, or the fit does not settle.
    """
    _check_coverage(drives)
    model = RobotModel(config)
    keys = [_chosen(drive, config) for drive in drives]
    bundle = _Bundle(model, keys, config)
    sigma_px = config.estimator.pixel_sigma_px
    for _ in range(_ROUNDS):
        sigma_px = bundle.solve(sigma_px)
    covariance = bundle.covariance * np.outer(model.sigmas, model.sigmas)
    return RobotCalibration(
        config=model.config(bundle.errors),
        names=tuple(model.names),
        units=tuple(model.units),
        values=model.values(bundle.errors),
        covariance=covariance,
        prior_sigma=model.sigmas,
        residual_px=sigma_px,
        images=sum(len(each.times_s) for each in keys),
    )


def _check_coverage(drives: Sequence[Drive]) -> None:
    if len(drives) < FEWEST_DRIVES:
        raise CoverageError(f"{len(drives)} drives: record {FEWEST_DRIVES} or more, from different sides")
    for number, drive in enumerate(drives, 1):
        if len(drive.frames_ns) < _FEWEST_IMAGES:
            raise CoverageError(f"drive {number}: {len(drive.frames_ns)} images, {_FEWEST_IMAGES} are needed")
        nearer = float(np.ptp(drive.poses[:, 0]))
        if nearer < _LEAST_APPROACH_M:
            raise CoverageError(f"drive {number} comes {nearer:.1f} m nearer: drive {_LEAST_APPROACH_M} m or more")
    sides = float(np.ptp([drive.poses[0, 1] for drive in drives]))
    if sides < _LEAST_SIDES_M:
        raise CoverageError(
            f"all drives begin within {sides:.2f} m from side to side: begin them {_LEAST_SIDES_M} m apart"
        )
    turned = float(max(np.ptp(drive.poses[:, 2]) for drive in drives))
    if turned < _LEAST_TURN_RAD:
        raise CoverageError(f"no drive turns by more than {math.degrees(turned):.0f}°: begin some of them askew")


def _chosen(drive: Drive, config: Config) -> KeyFrames:
    duration_s = float(drive.frames_ns[-1] - drive.frames_ns[0]) * 1e-9
    return key_frames(drive, config, max(duration_s / _IMAGES, _LEAST_EVERY_S))


class _Bundle:
    """Gauss-Newton over errors and states, with the derivatives' structure."""

    def __init__(self, model: RobotModel, keys: Sequence[KeyFrames], config: Config) -> None:
        self._model, self._keys = model, keys
        self.errors = np.zeros(model.size)
        self._states = [each.start.copy() for each in keys]
        self.covariance = np.eye(model.size)
        self._pixel_rows: list[tuple[Array, Array, Array]] = []
        estimator = config.estimator
        self._process = np.square(estimator.process_noise)
        self._by_distance = estimator.distance_noise**2

    def solve(self, sigma_px: float) -> float:
        """Fit with this noise of a coordinate [px]; what noise is left.

        Raises:
            CoverageError: it does not settle.
        """
        for _ in range(_ITERATIONS):
            matrix, vector = self._normal(sigma_px)
            step = np.asarray(np.linalg.solve(matrix, vector), dtype=np.float64)
            self._take(step)
            if np.abs(step[: self._model.size]).max() < _SETTLED:
                break
        else:
            raise CoverageError("the fit does not settle: are the drives of one robot, before one array?")
        matrix, _ = self._normal(sigma_px)
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        size = self._model.size
        self.covariance = inverse[:size, :size]
        return self._noise(inverse)

    def _take(self, step: Array) -> None:
        self.errors = self.errors + step[: self._model.size]
        at = self._model.size
        for row, states in enumerate(self._states):
            self._states[row] = states + step[at : at + states.size].reshape(states.shape)
            at += states.size

    def _normal(self, sigma_px: float) -> tuple[Array, Array]:
        """JᵀJ and Jᵀr of all whitened rows; the errors first, then the states of each drive."""
        size = self._model.size
        whole = size + sum(states.size for states in self._states)
        matrix, vector = np.zeros((whole, whole)), np.zeros(whole)
        matrix[:size, :size] = np.eye(size)
        vector[:size] = -self.errors
        self._pixel_rows = []
        at = size
        for keys, states in zip(self._keys, self._states, strict=True):
            self._add_drive(matrix, vector, at, keys, states, sigma_px)
            at += states.size
        lower = np.tril_indices(whole, -1)
        matrix[lower] = matrix.T[lower]
        return matrix, vector

    def _add_drive(
        self, matrix: Array, vector: Array, at: int, keys: KeyFrames, states: Array, sigma_px: float
    ) -> None:
        """Add one drive's rows; its states begin at column ``at``."""
        model, size = self._model, self._model.size
        by_errors, by_motion_errors = model.by_errors(self.errors, states, keys)
        a, b, r = self._pixel_part(keys, states, sigma_px, by_errors)
        f, g, h, off = self._wheel_part(keys, states, by_motion_errors)
        blocks = _products(b, b)
        cross = _products(a, b)
        pulls = _pulls(b, r)
        blocks[:, [3, 4], [3, 4]] += 1.0 / TILT_RAD**2
        pulls[:, 3:] -= states[:, 3:] / TILT_RAD**2
        blocks[:-1, :3, :3] += _products(f, f)
        pulls[:-1, :3] += _pulls(f, off)
        blocks[1:, range(3), range(3)] += h**2
        pulls[1:, :3] -= h * off
        cross[:-1, :, :3] += _products(g, f)
        cross[1:, :, :3] -= np.einsum("kri,kr->kir", g, h)
        between = -np.einsum("kri,kr->kir", f, h)
        matrix[:size, :size] += _products(a, a).sum(axis=0) + _products(g, g).sum(axis=0)
        vector[:size] += _pulls(a, r).sum(axis=0) + _pulls(g, off).sum(axis=0)
        for row in range(len(states)):
            here = slice(at + STATE * row, at + STATE * (row + 1))
            matrix[here, here] += blocks[row]
            matrix[:size, here] += cross[row]
            if row + 1 < len(states):
                matrix[here.start : here.start + 3, here.stop : here.stop + 3] += between[row]
        vector[at : at + states.size] += pulls.reshape(-1)

    def _pixel_part(
        self, keys: KeyFrames, states: Array, sigma_px: float, by_errors: Array
    ) -> tuple[Array, Array, Array]:
        """Whitened derivatives by errors and states, (k, 2n, …), and what is left, (k, 2n); unseen points weigh 0."""
        residual = (keys.pixels - self._model.pixels(self.errors, states)) / sigma_px
        seen = np.asarray(np.isfinite(residual).all(axis=2))
        residual = np.where(seen[:, :, None], residual, 0.0)
        weight: Array = seen.astype(np.float64) * np.sqrt(
            _HUBER / np.maximum(np.hypot(*np.moveaxis(residual, 2, 0)), _HUBER)
        )
        rows = weight[:, :, None, None] / sigma_px
        a = (rows * by_errors).reshape(len(states), -1, self._model.size)
        b = (rows * self._model.by_states(self.errors, states)).reshape(len(states), -1, STATE)
        self._pixel_rows.append((a, b, weight))
        return a, b, (weight[:, :, None] * residual).reshape(len(states), -1)

    def _wheel_part(
        self, keys: KeyFrames, states: Array, by_motion_errors: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Whitened derivatives of each expected next pose by the pose before and by the errors, (k - 1, 3, …), the
        weight of the next pose itself, (k - 1, 3), and how far that lies off, (k - 1, 3)."""
        motion = self._model.driven(self.errors, keys)
        after, by_pose, by_motion = moved(states[:-1], motion)
        spread = np.sqrt(
            self._process * np.diff(keys.times_s)[:, None]
            + self._by_distance * np.hypot(motion[:, 0], motion[:, 1])[:, None]
        )
        f, g = by_pose / spread[:, :, None], by_motion @ by_motion_errors / spread[:, :, None]
        return f, g, 1.0 / spread, (states[1:, :3] - after) / spread

    def _noise(self, inverse: Array) -> float:
        """Standard deviation of a coordinate by what the fit leaves, for as many as are free."""
        size, at = self._model.size, self._model.size
        square = free = 0.0
        for keys, states, (a, b, weight) in zip(self._keys, self._states, self._pixel_rows, strict=True):
            left = np.nan_to_num(keys.pixels - self._model.pixels(self.errors, states)) * weight[:, :, None]
            square += float((left**2).sum())
            free += 2.0 * float((weight > 0).sum())
            for row in range(len(states)):
                here = np.r_[0:size, at : at + STATE]
                slopes = np.hstack([a[row], b[row]])
                free -= float(np.einsum("ri,ij,rj->", slopes, inverse[np.ix_(here, here)], slopes))
                at += STATE
        return max(math.sqrt(square / max(free, 1.0)), _LEAST_PX)


def _products(left: Array, right: Array) -> Array:
    """LᵀR of each image, (k, i, j) from (k, r, i) and (k, r, j)."""
    return left.swapaxes(1, 2) @ right


def _pulls(slopes: Array, residual: Array) -> Array:
    """Jᵀr of each image, (k, i) from (k, r, i) and (k, r)."""
    pulled: Array = np.einsum("kri,kr->ki", slopes, residual)
    return pulled
