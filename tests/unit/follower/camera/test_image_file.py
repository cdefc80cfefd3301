"""Image files as cameras and tools write them: pixels as stored, whole, of the right brightness."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from follower.camera.image_file import depth_of, images_in, read_grey

RAMP = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))
_EXIF = b"\xff\xe1\x00\x22Exif\x00\x00MM\x00*\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00%c" + bytes(
    6
)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_stay_where_the_sensor_had_them(tmp_path: Path, orientation: int) -> None:
    plain = cv2.imencode(".jpg", RAMP)[1].tobytes()
    tagged = tmp_path / "tagged.jpg"
    tagged.write_bytes(plain[:2] + _EXIF % orientation + plain[2:])
    (tmp_path / "plain.jpg").write_bytes(plain)
    assert np.array_equal(np.asarray(read_grey(tagged)), np.asarray(read_grey(tmp_path / "plain.jpg")))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".pgm"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_truncated_file_is_no_image(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"image{suffix}"
    noise = np.random.default_rng(1).integers(0, 255, (120, 160)).astype(np.uint8)
    cv2.imwrite(str(path), noise)
    assert read_grey(path) is not None
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    assert read_grey(path) is None


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bits_are_scaled_by_what_the_sensor_used(tmp_path: Path, bits: int, suffix: str) -> None:
    full = (1 << bits) - 1
    dark, bright = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    cv2.imwrite(str(dark), np.full((48, 64), full // 4, np.uint16))
    cv2.imwrite(str(bright), np.full((48, 64), full, np.uint16))
    assert depth_of([dark, bright]) == bits
    shown = [read_grey(path, full) for path in (dark, bright)]
    assert [int(np.asarray(image).max()) for image in shown] == [64, 255]


@pytest.mark.parametrize("maxval", [63, 255, 1023, 4095, 65535])
def test_a_pgm_names_its_full_scale(tmp_path: Path, maxval: int) -> None:
    kind = np.uint8 if maxval < 256 else np.dtype(">u2")
    path = tmp_path / "a.pgm"
    header = f"P5\n# of a tool\n64 48\n{maxval}\n".encode()
    path.write_bytes(header + np.full((48, 64), maxval, kind).tobytes())
    assert int(np.asarray(read_grey(path)).max()) == 255


def test_files_of_eight_bits_keep_their_values_and_macs_files_are_passed_over(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), RAMP)
    (tmp_path / "._a.png").write_bytes(b"not an image")
    assert images_in(tmp_path) == [tmp_path / "a.png"]
    assert depth_of(images_in(tmp_path)) == 8
    assert np.array_equal(np.asarray(read_grey(tmp_path / "a.png")), RAMP)
