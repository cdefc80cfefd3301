"""Camera frames for a recording: some as JPEG, or all without loss."""

from __future__ import annotations

import cv2
import numpy as np

from common.errors import ConfigError
from common.frames.ring import Image

# without a filter a dark infrared image packs fastest, and smaller than with one
_LOSSLESS = (
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_NONE,
)


def jpeg(image: Image, quality: int) -> bytes:
    """An image as JPEG.

    Args:
        image: (height, width), 8-bit grey.
        quality: from 10 to 100.
    """
    return cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))[1].tobytes()


def lossless(image: Image) -> bytes:
    """An image as PNG, fast rather than small.

    Args:
        image: (height, width), 8-bit grey.
    """
    return cv2.imencode(".png", image, _LOSSLESS)[1].tobytes()


def pixels(data: bytes) -> Image:
    """The image (height, width) of JPEG or PNG bytes.

    Raises:
        ConfigError: they are neither.
    """
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ConfigError("a recorded picture is damaged")
    return np.asarray(image, np.uint8)
