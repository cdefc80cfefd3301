"""The baselines' gains; how each was found is in docs/results.md."""

from __future__ import annotations

TUNED: dict[str, dict[str, float]] = {
    "ibvs": {"gain_1_s": 0.677},
    "ke": {"theta": 0.1, "x": 1.0, "y": 10.0, "effort_v": 0.3, "effort_w": 0.3},
    "pose_based": {
        "k_phi": 1.66,
        "k_delta": 0.602,
        "beta": 0.325,
        "slowdown_m": 0.381,
        "reach_min_m": 0.504,
        "arrived_m": 0.0066,
    },
}


def tuned_gains(method: str) -> dict[str, float]:
    """By name; empty for a method whose weights are in the configuration."""
    return dict(TUNED.get(method, {}))
