"""What may be searched of each method, and where its gains live: in the configuration, or beside a baseline."""

from __future__ import annotations

from collections.abc import Mapping

from common.config import Config
from experiments.feature_level.baselines.gains import tuned_gains

Gains = dict[str, float]
Bounds = tuple[float, float]  # lowest and highest; searched on a logarithmic scale

SPACES: dict[str, dict[str, Bounds]] = {
    "ibvs": {"gain_1_s": (0.05, 3.0)},
    "ke": {
        "theta": (0.01, 10.0),
        "x": (0.1, 10.0),
        "y": (0.1, 100.0),
        "effort_v": (0.03, 3.0),
        "effort_w": (0.03, 3.0),
    },
    "pose_based": {
        "k_phi": (0.5, 6.0),
        "k_delta": (0.5, 6.0),
        "beta": (0.1, 2.0),
        "slowdown_m": (0.3, 2.5),
        "reach_min_m": (0.1, 1.5),
        "arrived_m": (0.002, 0.03),
    },
    "paper": {
        "effort_v": (3e-4, 3e-2),
        "effort_w": (1e-4, 1e-2),
        "terminal_theta": (0.3, 6.0),
        "bandwidth_rad_s": (0.3, 3.0),
    },
    "davpc": {
        "terminal_beta": (0.2, 3.0),
        "terminal_theta": (0.2, 5.0),
        "effort_v": (2e-5, 1e-3),
        "effort_w": (1e-5, 1e-3),
        "rate_v": (1e-3, 5e-2),
        "rate_w": (3e-4, 2e-2),
    },
}


def shipped(config: Config, method: str) -> Gains:
    """The gains in use now."""
    controller = config.controller
    if method == "paper":
        effort_v, effort_w = controller.effort_weight
        return {
            "effort_v": effort_v,
            "effort_w": effort_w,
            "terminal_theta": controller.terminal_weight_theta,
            "bandwidth_rad_s": controller.compensation.bandwidth_rad_s,
        }
    if method == "davpc":
        realtime = controller.realtime
        return {
            "terminal_beta": realtime.terminal_weight[1],
            "terminal_theta": realtime.terminal_weight[2],
            "effort_v": realtime.effort_weight[0],
            "effort_w": realtime.effort_weight[1],
            "rate_v": realtime.rate_weight[0],
            "rate_w": realtime.rate_weight[1],
        }
    return tuned_gains(method)


def with_gains(config: Config, method: str, gains: Mapping[str, float]) -> tuple[Config, Gains]:
    """The configuration with these gains, and those that are not in it.

    Args:
        config: the robots.
        method: one of ``SPACES``.
        gains: by the names of its space.
    """
    controller = config.controller
    if method == "paper":
        observer = controller.compensation.model_copy(update={"bandwidth_rad_s": gains["bandwidth_rad_s"]})
        changed = {
            "effort_weight": (gains["effort_v"], gains["effort_w"]),
            "terminal_weight_theta": gains["terminal_theta"],
            "compensation": observer,
        }
    elif method == "davpc":
        realtime = controller.realtime
        terminal = (realtime.terminal_weight[0], gains["terminal_beta"], gains["terminal_theta"])
        weights = {
            "terminal_weight": terminal,
            "effort_weight": (gains["effort_v"], gains["effort_w"]),
            "rate_weight": (gains["rate_v"], gains["rate_w"]),
        }
        changed = {"realtime": realtime.model_copy(update=weights)}
    else:
        return config, dict(gains)
    return config.model_copy(update={"controller": controller.model_copy(update=changed)}), {}
