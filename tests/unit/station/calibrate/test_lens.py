"""Lens calibration: right on lenses of every kind, and honest about what it has not seen."""

from __future__ import annotations

import math
from datetime import date
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import Config, LensConfig
from common.errors import ConfigError
from common.geometry import Array
from follower.camera.calibration_file import age_days, stored
from station.calibrate.board import Board, Coverage, counted_otherwise, coverage_of, find_corners
from station.calibrate.lens import Calibration, CalibrationError, calibrate_camera, fit_lens, holds, project, rays
from station.calibrate.lens_file import differences, store
from tests.rigs.ideal_lens import Law, image_by_law

SIZE = (1280, 1024)
FIELD_RAD = math.radians(120.0)
BOARD = Board(columns=9, rows=6, square_m=0.04)
LAWS: list[Law] = ["rectilinear", "stereographic", "equidistant"]


def boards(
    law: Law, draws: np.random.Generator, wanted: int = 16, spread: float = 1.0, field_rad: float = FIELD_RAD
) -> list[Array]:
    """Corners of boards held all over the image, with the noise of a good corner finder."""
    away = math.tan(0.5 * FIELD_RAD) / math.tan(0.5 * field_rad)
    centred = BOARD.points() - BOARD.points().mean(axis=0)
    views: list[Array] = []
    targets = [(x, y) for y in (-0.75, 0.0, 0.75) for x in (-0.85, -0.4, 0.0, 0.4, 0.85)]
    for attempt in range(4000):
        x, y = targets[attempt % len(targets)]
        angle = 0.5 * field_rad * spread * math.hypot(x, 0.75 * y) * draws.uniform(0.8, 1.15)
        around = math.atan2(y, x)
        axis = np.array([math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), math.cos(angle)])
        facing = cv2.Rodrigues(np.cross([0.0, 0.0, 1.0], axis) * angle / max(math.sin(angle), 1e-9))[0]
        turn = facing @ cv2.Rodrigues(draws.uniform(-0.45, 0.45, 3))[0]
        points_c = centred @ turn.T + axis * draws.uniform(0.25, 0.5) * away
        if np.any(points_c[:, 2] < 0.02):
            continue
        pixels = image_by_law(points_c, law, SIZE, field_rad)
        if np.all((pixels > 3) & (pixels < np.array(SIZE) - 4)):
            views.append(pixels + draws.normal(0.0, 0.05, pixels.shape))
        if len(views) == wanted:
            return views
    raise AssertionError(f"only {len(views)} boards in view")


@pytest.mark.parametrize("law", LAWS)
def test_rays_of_a_wide_lens_are_right_where_boards_were_seen(law: Law) -> None:
    views = boards(law, np.random.default_rng(4))
    found = calibrate_camera(views, BOARD, SIZE)
    assert found.rms_px < 0.1
    errors = []
    for angle in np.radians(np.arange(1.0, 55.0, 3.0)):
        around = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
        true = np.column_stack(
            [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.full(24, np.cos(angle))]
        )
        pixels = image_by_law(true, law, SIZE, FIELD_RAD)
        corners = np.concatenate(views)
        near = np.array([np.hypot(*(corners - pixel).T).min() < 40.0 for pixel in pixels])
        seen = rays(found.lens, pixels[near])
        directions = np.column_stack([seen, np.ones(len(seen))])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        errors += list(np.degrees(np.arccos(np.clip((directions * true[near]).sum(axis=1), -1.0, 1.0))))
    assert float(np.median(errors)) <= 0.05
    assert max(errors) <= 0.5
    assert found.held_out_px[found.kind] == min(found.held_out_px.values())
    assert found.lens.model == ("fisheye" if found.kind == "fisheye" else "rational")
    assert holds(found.lens, SIZE)


@pytest.mark.parametrize("seed", [0, 3])
def test_rays_of_a_narrow_lens_are_right_everywhere(seed: int) -> None:
    field_rad = math.radians(60.0)
    found = calibrate_camera(boards("rectilinear", np.random.default_rng(seed), field_rad=field_rad), BOARD, SIZE)
    assert holds(found.lens, SIZE)
    across = np.tan(0.5 * field_rad) * np.linspace(-1.0, 1.0, 201)
    true = np.array([(x, y, 1.0) for y in 0.79 * across[::4] for x in across])
    seen = rays(found.lens, image_by_law(true, "rectilinear", SIZE, field_rad))
    assert float(np.degrees(np.hypot(*(seen - true[:, :2]).T)).max()) <= 0.25


def test_a_lens_with_a_pole_in_the_image_does_not_hold() -> None:
    # eight coefficients fitted to thirteen photographs through a narrow lens, to 0.12 px
    eight = (86.77, 226.94, 2.3e-4, 6.9e-4, -1397.9, 86.44, 235.74, -1420.74)
    lens = LensConfig(model="rational", fx_px=514.4, fy_px=514.7, cx_px=313.5, cy_px=250.0, coefficients=eight)
    assert not holds(lens, (640, 512))
    assert holds(lens, (400, 320)), "the pole lies outside of a smaller image"
    five = lens.model_copy(update={"coefficients": (-0.0637, 0.0922, 3e-4, 8e-4, 0.0229, 0.0, 0.0, 0.0)})
    assert holds(five, (640, 512))


def test_a_lens_that_folds_its_image_does_not_hold() -> None:
    folded = LensConfig(
        model="fisheye", fx_px=420.0, fy_px=420.0, cx_px=640.0, cy_px=512.0, coefficients=(0.0, -0.3, 0.0, 0.0)
    )
    assert not holds(folded, SIZE)
    straight = folded.model_copy(update={"coefficients": (0.0, 0.0, 0.0, 0.0)})
    assert holds(straight, SIZE)


def test_projection_and_rays_undo_one_another() -> None:
    fitted = fit_lens("fisheye", boards("equidistant", np.random.default_rng(1), wanted=10), BOARD, SIZE)
    assert fitted is not None
    lens = fitted[0]
    points = np.array([[0.1, 0.2, 1.0], [-0.6, 0.3, 1.0], [0.9, -0.5, 1.0]])
    assert rays(lens, project(lens, points)) == pytest.approx(points[:, :2], abs=1e-5)


def test_poor_coverage_is_refused_with_what_is_missing() -> None:
    views = boards("rectilinear", np.random.default_rng(2), spread=0.2)
    with pytest.raises(CalibrationError, match=r"no board seen in these parts of the image: .*left"):
        calibrate_camera(views, BOARD, SIZE)


def test_boards_in_the_middle_alone_are_refused() -> None:
    centre = np.array([640.0, 512.0])
    views = boards("rectilinear", np.random.default_rng(2), wanted=40)
    inward = [centre + 0.6 * (view - centre) for view in views]
    with pytest.raises(CalibrationError, match=r"boards cover \d+% of the image, 55% are needed"):
        calibrate_camera(inward, BOARD, SIZE)


@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_boards_that_are_parallel_to_one_another_are_refused(turn_deg: float) -> None:
    views = _parallel_boards(np.radians(turn_deg), np.random.default_rng(3))
    with pytest.raises(CalibrationError, match=r"boards are not tilted .*do not determine the focal length"):
        calibrate_camera(views, BOARD, SIZE)


def _parallel_boards(turn_rad: float, noise: np.random.Generator) -> list[np.ndarray]:
    """Views all over the image, from two distances, every board turned by the same angle."""
    turn = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[0]
    middle = BOARD.points().mean(axis=0)
    found = []
    for depth_m in (0.5, 0.8):
        for column in np.linspace(140, 1140, 4):
            for row in np.linspace(120, 900, 4):
                shift = depth_m * np.array([(column - 640) / 500, (row - 512) / 500, 1.0])
                points = (BOARD.points() - middle) @ turn.T + shift
                view = points[:, :2] / points[:, 2:] * 500 + (640, 512)
                found.append(view + noise.normal(0.0, 0.1, view.shape))
    return [view for view in found if (view > 0).all() and (view < SIZE).all()]


def test_a_board_printed_out_of_proportion_is_named() -> None:
    lens = LensConfig(model="rational", fx_px=927.0, fy_px=900.0, cx_px=640.0, cy_px=512.0, coefficients=(0.0,) * 8)
    assert "fx and fy differ by 3.0 %" in Calibration(lens, 0.1, {"rational": 0.1}, Coverage(0.8, ()), 20).doubt
    square = lens.model_copy(update={"fx_px": 901.0})
    assert not Calibration(square, 0.1, {"rational": 0.1}, Coverage(0.8, ()), 20).doubt


def test_squares_taken_for_corners_are_named() -> None:
    tile = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((40, 40))) * 200 + 30
    image = np.full((480, 640), 230, np.uint8)
    image[80:360, 100:500] = tile.astype(np.uint8)
    said = counted_otherwise(image, Board(10, 7, 0.025))
    assert "a board of 10x7 squares has 9x6" in said
    assert not counted_otherwise(np.zeros((480, 640), np.uint8), Board(10, 7, 0.025))


def test_few_images_are_refused() -> None:
    views = boards("rectilinear", np.random.default_rng(2), wanted=5)
    with pytest.raises(CalibrationError, match="5 images with the whole board, at least 8"):
        calibrate_camera(views, BOARD, SIZE)


def test_coverage_names_regions() -> None:
    left = [np.column_stack([np.linspace(0, 500, 60), np.linspace(0, 1023, 60)])]
    coverage = coverage_of(left, SIZE)
    assert "right" in coverage.missing
    assert "top left" not in coverage.missing
    assert 0.0 < coverage.share < 0.5


def test_corners_are_found_to_sub_pixel() -> None:
    square = 40
    tile = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((square, square))) * 200 + 30
    image = np.full((480, 640), 230, np.uint8)
    image[80 : 80 + 7 * square, 100 : 100 + 10 * square] = tile.astype(np.uint8)
    turn = cv2.getRotationMatrix2D((320.0, 240.0), 11.0, 0.8)
    turned = cv2.warpAffine(image, turn, (640, 480), flags=cv2.INTER_LINEAR, borderValue=(230.0,))
    corners = find_corners(np.asarray(cv2.GaussianBlur(turned, (3, 3), 0.8), np.uint8), BOARD)
    assert corners is not None
    grid = np.mgrid[1:10, 1:7].T.reshape(-1, 2) * square + [99.5, 79.5]
    truth = grid @ turn[:, :2].T + turn[:, 2]
    distance = np.linalg.norm(corners[:, None] - truth[None], axis=2).min(axis=1)
    assert distance.max() < 0.15


def test_an_image_without_board_has_no_corners() -> None:
    assert find_corners(np.zeros((480, 640), np.uint8), BOARD) is None


def test_an_image_too_small_for_a_board_has_no_corners() -> None:
    for side in (1, 10, 31):
        assert find_corners(np.zeros((side, 640), np.uint8), Board(9, 6, 0.025)) is None


def test_calibration_is_stored_with_whose_it_is(tmp_path: Path) -> None:
    lens = LensConfig(
        model="fisheye", fx_px=420.0, fy_px=421.5, cx_px=639.0, cy_px=511.0, coefficients=(0.02, -4e-3, 1e-7, 0.0)
    )
    found = Calibration(lens, 0.12, {"rational": 0.3, "fisheye": 0.14}, Coverage(0.8, ()), 23)
    path = tmp_path / "camera.toml"
    store(found, 'serial "7"', "2026-05-04", SIZE, path)
    again = stored(path)
    assert (again.camera, again.date, (again.width_px, again.height_px), again.lens) == (
        'serial "7"',
        "2026-05-04",
        SIZE,
        lens,
    )
    assert (again.rms_px, again.held_out_px, again.coverage, again.views) == (0.12, 0.14, 0.8, 23)
    path.write_text(path.read_text().replace("fisheye", "mirror"))
    with pytest.raises(ConfigError, match=r"camera\.toml: lens\.model"):
        stored(path)
    with pytest.raises(ConfigError, match="not a calibration"):
        stored(tmp_path / "missing.toml")


def test_a_stored_calibration_is_compared_with_the_configuration(config: Config, tmp_path: Path) -> None:
    lens = config.camera.lens
    path = tmp_path / "camera.toml"
    store(Calibration(lens, 0.1, {"rational": 0.2}, Coverage(0.8, ()), 20), "7", "2026-05-04", SIZE, path)
    assert differences(stored(path), config.camera) == []
    assert age_days(stored(path), date(2026, 6, 4), path) == 31
    other = lens.model_copy(update={"fx_px": 400.0})
    changed = config.camera.model_copy(update={"lens": other, "width_px": 640})
    said = differences(stored(path), changed)
    assert said == ["image 640×1024 instead of 1280×1024", "camera.lens.fx_px = 400.0 instead of 369.5"]
    bent = LensConfig(
        model="fisheye", fx_px=420.0, fy_px=420.0, cx_px=640.0, cy_px=512.0, coefficients=(0.0, -0.3, 0.0, 0.0)
    )
    store(Calibration(bent, 0.1, {"fisheye": 0.2}, Coverage(0.8, ()), 20), "7", "2026-05-04", SIZE, path)
    said = differences(stored(path), config.camera.model_copy(update={"lens": bent}))
    assert said == ["a camera.lens that does not hold over the whole image: calibrate it again"]
    path.write_text(path.read_text().replace("2026-05-04", "yesterday"))
    with pytest.raises(ConfigError, match=r"camera\.toml: date"):
        age_days(stored(path), date(2026, 6, 4), path)
