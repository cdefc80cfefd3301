"""Basic image-based visual servoing (Chaumette et al. 2016): u = −λ J_s⁺ (s − s*)."""

from __future__ import annotations

import numpy as np

from common.geometry import Array, interaction_matrix


def ibvs(
    features: Array, desired: Array, height_difference_m: Array, camera_xyz_m: Array, gain_1_s: float
) -> tuple[float, float]:
    """Velocity v [m/s], ω [rad/s]; standstill with fewer than two features.

    Args:
        features: (n, 2) normalised, NaN where not seen.
        desired: (n, 2) s*.
        height_difference_m: (n,) Δh = Z_C − Z_P per point.
        camera_xyz_m: ξ in {F} [m].
        gain_1_s: λ.
    """
    seen = np.isfinite(features[:, 0])
    if seen.sum() < 2:
        return 0.0, 0.0
    jacobian = interaction_matrix(features[seen], height_difference_m[seen], camera_xyz_m).reshape(-1, 2)
    error = (features[seen] - desired[seen]).reshape(-1)
    v, w = -gain_1_s * np.linalg.lstsq(jacobian, error, rcond=None)[0]
    return float(v), float(w)
