"""Following identified LEDs from frame to frame: eq. (feature_prediction), nearest spot within a gate."""

from __future__ import annotations

import numpy as np

from common.geometry import Array, interaction_matrix


def predict_features(
    features: Array, height_difference_m: Array, camera_xyz_m: Array, twist: tuple[float, float], duration_s: float
) -> Array:
    """Features (n, 2) after the Follower drove ``twist`` = (v [m/s], ω [rad/s]): eq. (feature_prediction)."""
    flow = interaction_matrix(features, height_difference_m, camera_xyz_m) @ np.array(twist)
    predicted: Array = features + flow * duration_s
    return predicted


def nearest_within(predicted_px: Array, spots_px: Array, gate_px: float) -> list[int]:
    """Spot of each predicted LED: the nearest within the gate, each spot at most once, −1 where there is none."""
    chosen = [-1] * len(predicted_px)
    if not len(spots_px):
        return chosen
    distance = np.hypot(
        predicted_px[:, 0, None] - spots_px[None, :, 0], predicted_px[:, 1, None] - spots_px[None, :, 1]
    )
    while True:
        led, spot = divmod(int(np.argmin(distance)), len(spots_px))
        if not distance[led, spot] <= gate_px:
            return chosen
        chosen[led] = spot
        distance[led, :] = np.inf
        distance[:, spot] = np.inf
