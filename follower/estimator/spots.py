"""From grey levels to spots with sub-pixel centroids: eqs. (14)–(16), threshold, moments, centroid."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from common.frames.ring import Image
from common.geometry import Array

Weighting = Literal["paper", "above_threshold"]
SATURATED = 250
PEAK_FRACTION = 0.4
MOST_CONTOURS = 500
MOST_MEASURED = 100
_MOST_SPLIT = 20
_MOST_PARTS = 12
_RUNS_EVERY = 8
_MOST_RUNS = 500  # in every eighth row; the named scenes make 60 at most
_SMALL = 128
_STRIP = 32  # rows, a multiple of _RUNS_EVERY
_SPLIT_FRACTIONS = (0.55, 0.75, 0.9)
_LONG = 1.4


class NoisyImageError(Exception):
    """More bright specks than lamps, mirrors and sun can make; to measure them all would take seconds."""


@dataclass(frozen=True)
class Spots:
    """Spots of one image, one row each.

    Attributes:
        pixels: (N, 2) centroids in {Π} [px].
        mass: (N,) sum of the weights [grey levels].
        peak: (N,) brightest pixel [grey levels].
        size_px: (N, 2) width and height of the bounding box [px].
        elongation: (N,) ratio of the weights' two standard deviations, 1 for a diamond.
    """

    pixels: Array
    mass: Array
    peak: Array
    size_px: Array
    elongation: Array

    def __len__(self) -> int:
        return len(self.mass)

    def take(self, rows: Array | list[int]) -> Spots:
        """The given rows only.

        Args:
            rows: their indices.
        """
        picked = np.asarray(rows, dtype=np.intp)
        return Spots(*(values[picked] for values in vars(self).values()))


@dataclass(frozen=True)
class SpotRule:
    """What counts as a spot, and how its centroid is weighted.

    ``paper`` weights by I′ above λ_I; ``above_threshold`` by I − λ with λ raised to a part of the spot's own
    peak, which is 2–5 times less noisy and leaves a dim neighbour that has grown into the spot outside.
    """

    threshold: int
    min_area_px: int
    max_area_px: int
    weighting: Weighting = "above_threshold"


Window = tuple[int, int, int, int]
Band = tuple[int, int]
_Row = tuple[float, float, float, float, float, float, float]


def find_spots(image: Image, rule: SpotRule) -> Spots:
    """All spots of the image.

    Args:
        image: (h, w) uint8.
        rule: what counts as a spot.

    Raises:
        NoisyImageError: there are too many.
    """
    height, width = image.shape
    return _gather(_spots_in(image, (0, 0, width, height), rule))


def find_spots_near(image: Image, centres: Array, half_px: int, rule: SpotRule) -> Spots:
    """Spots in square regions around predicted centres.

    Overlapping regions are joined first, so that no spot is found twice. A spot that touches the edge of its
    region, yet not that of the image, is left out: part of it is missing.

    Args:
        image: (h, w) uint8.
        centres: (n, 2) [px].
        half_px: half the side of a region.
        rule: what counts as a spot.
    """
    height, width = image.shape
    rows: list[_Row] = []
    for left, top, right, bottom in _join(_regions(centres, half_px, width, height)):
        for row in _spots_in(image, (left, top, right, bottom), rule):
            if not _cut(row, (left, top, right, bottom), width, height):
                rows.append(row)
    return _gather(rows)


def background(image: Image) -> tuple[float, float]:
    """Median grey level of a sparse sample, and the saturated part of it, 0 … 1.

    Args:
        image: (h, w) uint8.
    """
    counts = np.bincount(image[16::32, 16::32].ravel(), minlength=256).cumsum()
    total = int(counts[-1])
    return float(np.searchsorted(counts, total // 2, side="right")), 1.0 - float(counts[SATURATED - 1]) / total


def brightest(spots: Spots, count: int) -> Spots:
    """The ``count`` spots of the greatest mass, in their order."""
    if len(spots) <= count:
        return spots
    return spots.take(np.sort(np.argpartition(spots.mass, -count)[-count:]))


def _spots_in(image: Image, window: Window, rule: SpotRule) -> Iterable[_Row]:
    left, top, right, bottom = window
    region = image[top:bottom, left:right]
    boxes = [
        (x, y, w, h)
        for x, y, w, h in _components(region, rule.threshold)
        if rule.min_area_px <= w * h <= rule.max_area_px
    ]
    if len(boxes) > MOST_MEASURED:
        boxes = sorted(boxes, key=lambda box: box[2] * box[3])[-MOST_MEASURED:]
    splits = _MOST_SPLIT
    for x, y, w, h in boxes:
        box = region[y : y + h, x : x + w]
        row = _measure(box, left + x, top + y, rule)
        if row is not None and row[6] > _LONG and rule.weighting != "paper" and splits > 0:
            splits -= 1
            yield from _split(box, left + x, top + y, rule, row)
        elif row is not None:
            yield row


def _components(region: Image, level: float) -> list[Window]:
    """Bounding boxes (x, y, width, height) of what is brighter than the level, from below."""
    large = len(region) > _SMALL
    bands = _lit_bands(region, level) if large else [(0, len(region))]
    masks = [(top, _brighter(region[top:end], level)) for top, end in bands]
    if large:
        _refuse_noise([mask for _, mask in masks])
    boxes: list[Window] = []
    for top, mask in reversed(masks):
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if len(boxes) + len(contours) > MOST_CONTOURS:
            raise NoisyImageError(f"more than {MOST_CONTOURS} bright specks")
        boxes += [(x, top + y, w, h) for x, y, w, h in map(cv2.boundingRect, contours)]
    return boxes


def _brighter(region: Image, level: float) -> Image:
    """255 where it is brighter than the level, else 0."""
    return np.asarray(cv2.threshold(region, level, 255, cv2.THRESH_BINARY)[1], dtype=np.uint8)


def _lit_bands(region: Image, level: float) -> list[Band]:
    """Rows [top, end) that hold all that is brighter than the level, dark rows between them.

    Most of an image is dark, and its brightest pixels cost a tenth of what its contours cost.
    """
    whole = len(region) // _STRIP
    brightest = region[: whole * _STRIP].reshape(whole, -1).max(axis=1).tolist()
    brightest.append(region[whole * _STRIP :].max(initial=0))
    bands: list[Band] = []
    for strip, grey in enumerate(brightest):
        top, end = strip * _STRIP, min((strip + 1) * _STRIP, len(region))
        if grey > level and bands and bands[-1][1] == top:
            bands[-1] = (bands[-1][0], end)
        elif grey > level:
            bands.append((top, end))
    return bands


def _refuse_noise(masks: list[Image]) -> None:
    """Refuse masks of so many specks that finding them takes too long, by the bright runs in a sample of rows."""
    sampled = [mask[_RUNS_EVERY // 2 :: _RUNS_EVERY] for mask in masks]
    runs = sum(int(np.count_nonzero(rows[:, 1:] > rows[:, :-1])) for rows in sampled)
    if runs > _MOST_RUNS:
        raise NoisyImageError(f"{runs} bright runs in every {_RUNS_EVERY}th row, at most {_MOST_RUNS} are looked at")


def _split(box: Image, x0: int, y0: int, rule: SpotRule, whole: _Row) -> list[_Row]:
    """A long spot as its parts, if a higher level parts it into one round spot or more; else as it was."""
    for fraction in _SPLIT_FRACTIONS:
        boxes = _components(box, fraction * whole[3])
        if len(boxes) > _MOST_PARTS:
            break  # mottled, no lamps side by side
        parts = [
            row
            for x, y, w, h in boxes
            if (row := _measure(box[y : y + h, x : x + w], x0 + x, y0 + y, rule)) is not None
        ]
        if parts and max(parts, key=lambda row: row[2])[6] <= _LONG:
            return parts
    return [whole]


def _measure(box: Image, x0: int, y0: int, rule: SpotRule) -> _Row | None:
    peak = cv2.minMaxLoc(box)[1]
    if rule.weighting == "paper":
        _, weights = cv2.threshold(box, rule.threshold, 255, cv2.THRESH_TOZERO)
    else:
        level = np.uint8(max(rule.threshold, int(PEAK_FRACTION * peak)))
        weights = np.maximum(box, level) - level
    moments = cv2.moments(weights)
    mass = moments["m00"]
    if mass <= 0.0:
        return None
    height, width = box.shape
    return (
        x0 + moments["m10"] / mass,
        y0 + moments["m01"] / mass,
        mass,
        peak,
        float(width),
        float(height),
        _elongation(moments["mu20"] / mass, moments["mu02"] / mass, moments["mu11"] / mass),
    )


def _elongation(xx: float, yy: float, xy: float) -> float:
    """Ratio of the principal standard deviations; a pixel's own variance 1/12 keeps thin spots finite."""
    pixel = 1.0 / 12.0
    mean = 0.5 * (xx + yy) + pixel
    spread = math.hypot(0.5 * (xx - yy), xy)
    return math.sqrt((mean + spread) / max(mean - spread, 1e-9))


def _gather(rows: Iterable[_Row]) -> Spots:
    table = np.array(list(rows), dtype=np.float64).reshape(-1, 7)
    return Spots(table[:, 0:2], table[:, 2], table[:, 3], table[:, 4:6], table[:, 6])


def _regions(centres: Array, half_px: int, width: int, height: int) -> list[Window]:
    windows = []
    for u, v in centres.tolist():
        if not (math.isfinite(u) and math.isfinite(v)):
            continue
        left, top = max(int(u) - half_px, 0), max(int(v) - half_px, 0)
        right, bottom = min(int(u) + half_px + 1, width), min(int(v) + half_px + 1, height)
        if left < right and top < bottom:
            windows.append((left, top, right, bottom))
    return windows


def _join(windows: list[Window]) -> list[Window]:
    """Windows that overlap, replaced by the one around both, until none do."""
    joined: list[Window] = []
    for window in windows:
        current = window
        while other := next((known for known in joined if _overlap(known, current)), None):
            joined.remove(other)
            current = (
                min(current[0], other[0]),
                min(current[1], other[1]),
                max(current[2], other[2]),
                max(current[3], other[3]),
            )
        joined.append(current)
    return joined


def _overlap(a: Window, b: Window) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _cut(row: _Row, window: Window, width: int, height: int) -> bool:
    """Whether the spot's half extent about its centroid reaches an edge of the window inside the image."""
    u, v, _, _, w, h, _ = row
    left, top, right, bottom = window
    return (
        (left > 0 and u - w / 2 < left)
        or (top > 0 and v - h / 2 < top)
        or (right < width and u + w / 2 > right - 1)
        or (bottom < height and v + h / 2 > bottom - 1)
    )
