"""``davpc camera focus``: what the image shows of focus, exposure and filter while you turn the lens."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from common.frames.ring import Image
from follower.estimator.spots import SATURATED, NoisyImageError, SpotRule, background, brightest, find_spots

_CORE = 0.5
_LAMPS = 12


@dataclass(frozen=True)
class FocusReport:
    """One image.

    Attributes:
        sharpness: variance of the Laplacian over the brightest spots' boxes; grows as focus gets better.
        spot_width_px: median width of the spots at half their peak: small in focus.
        saturated_percent: share of the spots whose peak is clipped.
        background_grey: median grey level.
        spots: spots found.
        advice: one line on what to change.
    """

    sharpness: float
    spot_width_px: float
    saturated_percent: float
    background_grey: float
    spots: int
    advice: str


def focus_report(image: Image, rule: SpotRule) -> FocusReport:
    """Judge focus, exposure and filter by one image.

    Args:
        image: (height, width) grey, uint8.
        rule: which spots count.
    """
    level, white = background(image)
    try:
        spots = brightest(find_spots(image, rule), _LAMPS)
    except NoisyImageError:
        advice = "bright specks everywhere: is the filter in? lower exposure_us or gain"
        return FocusReport(0.0, 0.0, 0.0, level, 0, advice)
    if not len(spots):
        advice = "overexposed: lower exposure_us or gain" if white > 0.05 else "no spots: LEDs on? lens cap off?"
        return FocusReport(0.0, 0.0, 0.0, level, 0, advice)
    widths, sharp = [], []
    for (u, v), (width, height), peak in zip(spots.pixels, spots.size_px, spots.peak, strict=True):
        half_w, half_h = int(width / 2) + 3, int(height / 2) + 3
        rows = slice(max(round(v) - half_h, 0), round(v) + half_h + 1)
        box = image[rows, max(round(u) - half_w, 0) : round(u) + half_w + 1]
        widths.append(float(np.sqrt((box > _CORE * peak).sum())))
        sharp.append(float(cv2.Laplacian(box, cv2.CV_64F).var()))
    clipped = 100.0 * float((spots.peak >= SATURATED).mean())
    return FocusReport(
        float(np.median(sharp)), float(np.median(widths)), clipped, level, len(spots), _advice(level, spots.peak)
    )


def _advice(level: float, peaks: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    if level > 60.0:
        return "bright background: shorten exposure_us; is the filter in?"
    if float(np.median(peaks)) < 60.0:
        return "dim spots: raise exposure_us, then gain"
    return "turn the lens until sharpness is greatest and spots are smallest"
