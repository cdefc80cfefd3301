"""Image files, read by one reader for replay, calibration and snapshots: whole, in grey, as the sensor gave them.

OpenCV by itself turns an image by its EXIF tag, fills what a truncated file lacks with grey, and takes the upper
8 of 16 bits whatever the sensor's depth was.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from common.frames.ring import Image

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")
_DEPTHS = (8, 10, 12, 14)
_FLAGS = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_PGM = re.compile(rb"P([25])(?:\s+|#[^\n]*\n)+(\d+)(?:\s+|#[^\n]*\n)+(\d+)(?:\s+|#[^\n]*\n)+(\d+)\s")
_MOST_SAMPLED = 64


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder, without the ``._`` files that a Mac leaves beside them."""
    found = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    return [path for path in found if not path.name.startswith("._")]


def read_grey(path: Path, full_scale: int = 65535) -> Image | None:
    """An image file in grey, pixels where the file has them; None if it is truncated or OpenCV cannot read it.

    Args:
        path: of the file.
        full_scale: greatest value of a 16-bit file, which becomes 255; a PGM names its own.
    """
    read = _read(path)
    if read is None:
        return None
    pixels, own_scale = read
    scale = own_scale or (full_scale if pixels.dtype == np.uint16 else 255)
    if scale == 255:
        return np.asarray(np.minimum(pixels, 255), np.uint8)
    return np.asarray(np.minimum(pixels.astype(np.float32) * (255.0 / scale) + 0.5, 255.0), np.uint8)


def depth_of(paths: Sequence[Path]) -> int:
    """Bits that the 16-bit files among these use, of 64 of them at most: 8 (none is of 16 bits), 10, 12, 14 or 16."""
    step = -(-len(paths) // _MOST_SAMPLED) or 1
    brightest = 0
    for number, path in enumerate(paths[::step]):
        read = _read(path)
        if read is not None and read[0].dtype == np.uint16 and not read[1]:
            brightest = max(brightest, int(read[0].max()))
        elif number == 0:
            return 8
    return next((bits for bits in _DEPTHS[1:] if brightest < 1 << bits), 16)


def _read(path: Path) -> tuple[np.ndarray, int] | None:
    """Pixels as stored, of 8 or 16 bits, and the full scale that a PGM names, else 0."""
    try:
        data = path.read_bytes()
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS) if data and _is_whole(data) else None
    except (cv2.error, OSError):  # larger than OpenCV takes; a folder
        return None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        return None
    header = _PGM.match(data)
    return pixels, int(header[4]) if header is not None else 0


def _is_whole(data: bytes) -> bool:
    """Whether the file's end is there."""
    if data[:2] == b"\xff\xd8":
        return data.find(b"\xff\xd9", max(data.rfind(b"\xff\xda"), 2)) >= 0
    if data[:4] == b"\x89PNG":
        return b"IEND" in data[-4096:]
    if data[:2] == b"BM" and len(data) >= 54:
        start, width, height, bits, packed = (*struct.unpack_from("<I4xii2xHI", data, 10),)
        return bool(packed) or len(data) >= start + (abs(width) * bits + 31) // 32 * 4 * abs(height)
    header = _PGM.match(data)
    if header is not None and header[1] == b"5":
        bytes_each = 1 if int(header[4]) < 256 else 2
        return len(data) - header.end() >= int(header[2]) * int(header[3]) * bytes_each
    return True
