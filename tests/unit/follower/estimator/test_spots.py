"""Spots: centroids, regions, and what does not count as a spot."""

from __future__ import annotations

from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from common.frames.ring import Image
from follower.estimator import spots as module
from follower.estimator.spots import MOST_MEASURED, NoisyImageError, SpotRule, brightest, find_spots, find_spots_near

RULE = SpotRule(threshold=40, min_area_px=2, max_area_px=6000)


def diamond(u: float, v: float, peak: float, width_px: float = 1.3) -> Image:
    """A noiseless speck, sampled eight times finer than the pixels."""
    fine = (np.arange(8) + 0.5) / 8 - 0.5
    x = (np.arange(160)[:, None] + fine).ravel() - u
    y = (np.arange(120)[:, None] + fine).ravel() - v
    light = np.outer(np.exp(-np.abs(y) / width_px), np.exp(-np.abs(x) / width_px)) * peak
    pixels = light.reshape(120, 8, 160, 8).mean(axis=(1, 3))
    image: Image = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
    return image


@pytest.mark.parametrize("peak", [150.0, 1000.0, 8000.0])
@pytest.mark.parametrize(("u", "v"), [(60.0, 50.0), (60.3, 50.4), (59.5, 49.75)])
def test_centroid_is_sub_pixel_also_when_saturated(u: float, v: float, peak: float) -> None:
    spots = find_spots(diamond(u, v, peak), RULE)
    assert len(spots) == 1
    assert spots.pixels[0] == pytest.approx([u, v], abs=0.12)
    assert spots.elongation[0] == pytest.approx(1.0, abs=0.25)


def test_paper_weights_keep_the_background_that_the_default_subtracts() -> None:
    image = diamond(60.3, 50.4, 200.0)
    paper = find_spots(image, SpotRule(40, 2, 6000, weighting="paper"))
    assert paper.mass[0] == image[image > 40].sum()
    assert find_spots(image, RULE).mass[0] < paper.mass[0]


def test_small_and_large_components_are_no_spots() -> None:
    image = np.zeros((120, 160), np.uint8)
    image[10, 10] = 200
    image[30:115, 40:130] = 200
    assert len(find_spots(image, RULE)) == 0


def test_regions_find_the_same_centroid_and_count_no_spot_twice() -> None:
    image = np.maximum(diamond(60.3, 50.4, 900.0), diamond(78.0, 50.0, 900.0))
    whole = find_spots(image, RULE)
    near = find_spots_near(image, np.array([[61.0, 50.0], [77.0, 51.0], [np.nan, 3.0]]), 20, RULE)
    assert len(near) == 2
    assert near.pixels[near.pixels[:, 0].argsort()] == pytest.approx(whole.pixels[whole.pixels[:, 0].argsort()])


def test_spot_cut_by_its_region_is_left_out() -> None:
    image = diamond(60.0, 50.0, 2000.0)
    assert len(find_spots_near(image, np.array([[39.0, 50.0]]), 20, RULE)) == 0


def test_regions_outside_the_image_are_empty() -> None:
    image = diamond(60.0, 50.0, 2000.0)
    assert len(find_spots_near(image, np.array([[-500.0, 50.0], [60.0, 9000.0]]), 20, RULE)) == 0


def test_brightest_keeps_the_heaviest_in_order() -> None:
    image = np.maximum(np.maximum(diamond(20.0, 50.0, 300.0), diamond(60.0, 50.0, 90.0)), diamond(99.0, 50.0, 3000.0))
    spots = find_spots(image, RULE)
    kept = brightest(spots, 2)
    assert sorted(round(u) for u in kept.pixels[:, 0]) == [20, 99]


def specks(image: Image, corners: NDArray[np.int_], side: int) -> Image:
    for u, v in corners:
        image[v : v + side, u : u + side] = 200
    return image


@pytest.mark.parametrize("share", [0.005, 0.01, 0.05, 0.3])
def test_a_noisy_image_is_refused_before_its_specks_are_looked_for(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(*_: object) -> None:
        raise AssertionError("a speck of noise was measured")

    monkeypatch.setattr(module, "_measure", measured)
    salt = np.where(np.random.default_rng(0).random((1024, 1280)) < share, 255, 0).astype(np.uint8)
    with pytest.raises(NoisyImageError):
        find_spots(salt, RULE)


def test_of_many_specks_the_largest_are_measured() -> None:
    grid = np.stack(np.meshgrid(np.arange(10, 1270, 40), np.arange(10, 410, 40)), axis=-1).reshape(-1, 2)
    image = specks(np.zeros((1024, 1280), np.uint8), grid, 3)
    specks(image, grid[:4] + np.array([0, 500]), 9)
    found = find_spots(image, RULE)
    assert len(found) == MOST_MEASURED
    assert np.count_nonzero(found.size_px[:, 0] == 9) == 4


def test_long_noise_is_parted_only_so_often(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = np.random.default_rng(1)
    image = np.zeros((1024, 1280), np.uint8)
    for u, v in np.stack(np.meshgrid(np.arange(10, 1200, 60), np.arange(10, 250, 60)), axis=-1).reshape(-1, 2):
        image[v : v + 3, u : u + 30] = draws.integers(80, 250, (3, 30))
    split = Mock(side_effect=module._split)
    monkeypatch.setattr(module, "_split", split)
    assert len(find_spots(image, RULE)) >= 80
    assert 0 < split.call_count <= 20


@pytest.mark.parametrize("height", [1024, 1000, 129])
def test_spots_are_found_in_every_row_of_the_image(height: int) -> None:
    for top in [*range(0, height - 4, 13), height - 4]:
        image = np.zeros((height, 64), np.uint8)
        image[top : top + 4, 30:34] = 200
        found = find_spots(image, RULE)
        assert found.pixels.tolist() == [[31.5, top + 1.5]]
        assert found.size_px.tolist() == [[4.0, 4.0]]


def test_spots_in_dark_and_bright_rows_are_those_of_one_search() -> None:
    draws = np.random.default_rng(4)
    image = np.zeros((1000, 1280), np.uint8)
    corners = draws.integers(0, [1280 - 9, 1000 - 9], (40, 2))
    for (u, v), side in zip(corners, draws.integers(3, 9, 40), strict=True):
        image[v : v + side, u : u + side] = 150
    contours, _ = cv2.findContours(
        (image > RULE.threshold).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    boxes = [cv2.boundingRect(contour) for contour in contours]
    found = find_spots(image, SpotRule(RULE.threshold, 2, 6000, weighting="paper"))
    assert found.size_px.tolist() == [[float(w), float(h)] for _, _, w, h in boxes]
