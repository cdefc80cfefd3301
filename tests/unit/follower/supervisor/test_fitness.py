"""Nothing is armed with another camera's lens, an old one, or a certificate that is about to expire."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest

from common.config import CameraConfig, Config
from common.messages import GatewayState
from follower.supervisor.fitness import CalibrationWatch, certificate_unfit

TODAY = date(2026, 11, 28)
GATEWAY = GatewayState(True, 1e7, "")


def camera_of(config: Config, **changes: Any) -> CameraConfig:
    return config.camera.model_copy(update={"calibration": "lens.toml", **changes})


def write(folder: Path, camera: CameraConfig, **changes: Any) -> Path:
    lens = camera.lens
    table = {
        "camera": "A1",
        "date": TODAY.isoformat(),
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "rms_px": 0.1,
        "held_out_px": 0.1,
        "coverage": 0.9,
        "views": 20,
        **changes,
    }
    lines = [f"{key} = {value!r}" for key, value in table.items()]
    lines += ["[lens]", f"model = {lens.model!r}", f"coefficients = {list(lens.coefficients)}"]
    lines += [f"{key} = {getattr(lens, key)!r}" for key in ("fx_px", "fy_px", "cx_px", "cy_px")]
    (folder / "lens.toml").write_text("\n".join(lines) + "\n")
    return folder / "robots.toml"


def test_without_a_calibration_file_nothing_is_judged(config: Config, tmp_path: Path) -> None:
    assert CalibrationWatch(config.camera, tmp_path / "robots.toml", TODAY).unfit("B2") == ""


def test_the_lens_of_the_camera_in_use_is_fit(config: Config, tmp_path: Path) -> None:
    watch = CalibrationWatch(camera_of(config), write(tmp_path, config.camera), TODAY)
    assert watch.unfit(None) == ""
    assert watch.unfit("A1") == ""
    assert "is of camera A1, frames come from B2" in watch.unfit("B2")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"date": (TODAY - timedelta(days=366)).isoformat()}, "366 days old, more than 365"),
        ({"date": (TODAY + timedelta(days=1)).isoformat()}, "is the clock right"),
        ({"date": "yesterday"}, "date: "),
        ({"width_px": 640}, "instead of 640"),
        ({"views": "many"}, "views"),
    ],
)
def test_what_does_not_fit_is_named(config: Config, tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    watch = CalibrationWatch(camera_of(config), write(tmp_path, config.camera, **changes), TODAY)
    text = watch.unfit("A1")
    assert text.startswith("camera.calibration: ")
    assert said in text
    assert "lens.toml" in text


def test_on_its_last_day_a_calibration_is_fit(config: Config, tmp_path: Path) -> None:
    path = write(tmp_path, config.camera, date=(TODAY - timedelta(days=365)).isoformat())
    assert CalibrationWatch(camera_of(config), path, TODAY).unfit("A1") == ""


def test_another_focal_length_is_another_lens(config: Config, tmp_path: Path) -> None:
    path = write(tmp_path, config.camera)
    lens = config.camera.lens.model_copy(update={"fx_px": 400.0})
    assert "camera.lens.fx_px = 400.0 instead of" in CalibrationWatch(
        camera_of(config, lens=lens), path, TODAY
    ).unfit("A1")


@pytest.mark.parametrize("content", [None, b"", b"\xff", b"[lens", b"a = " + b"[" * 5000])
def test_a_missing_or_spoilt_file_is_named(config: Config, tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "lens.toml").write_bytes(content)
    text = CalibrationWatch(camera_of(config), tmp_path / "robots.toml", TODAY).unfit("A1")
    assert text.startswith(f"camera.calibration: {tmp_path / 'lens.toml'}: ")
    assert "\n" not in text


@pytest.mark.parametrize(
    ("gateway", "said"),
    [
        (None, ""),
        (GATEWAY, ""),
        (replace(GATEWAY, certificate_left_s=24.5 * 3600), ""),
        (replace(GATEWAY, certificate_left_s=24.0 * 3600 + 1.0), ""),
        (replace(GATEWAY, certificate_left_s=24.0 * 3600), "the certificate expires in 24.0 h"),
        (replace(GATEWAY, certificate_left_s=8.2501 * 3600), "the certificate expires in 8.3 h"),
        (replace(GATEWAY, certificate_left_s=23.5 * 3600), "the certificate expires in 23.5 h"),
        (replace(GATEWAY, certificate_left_s=-10.0), "the certificate expires in 0.0 h"),
    ],
)
def test_a_certificate_with_less_than_a_day_left(gateway: GatewayState | None, said: str) -> None:
    assert certificate_unfit(gateway).startswith(said)
    assert bool(certificate_unfit(gateway)) == bool(said)
