"""A Follower that stands docked before the array, as its camera sees it."""

from __future__ import annotations

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, features_at

FOCAL_PX = 369.5


def docked(config: Config, count: int = 40, noise_px: float = 0.05) -> tuple[list[Array], list[Pose2]]:
    draws = np.random.default_rng(1)
    clean = features_at(config.leds.points, Pose2(1.51, 0.0, 0.0), config.camera.mount)
    features = [clean + draws.normal(0.0, noise_px / FOCAL_PX, clean.shape) for _ in range(count)]
    return features, [Pose2(1.51, 0.0, 0.0)] * count
