"""The configuration with one thing changed."""

from __future__ import annotations

import numpy as np

from common.config import Config


def with_horizon(config: Config, horizon: int) -> Config:
    """The same with another N_p; knots keep their places in proportion, the first ones each step."""
    knots = config.controller.realtime.knots
    scale = (horizon - 1) / knots[-1]
    placed = sorted({0, 1, 2, 3, horizon - 1, *(round(k * scale) for k in knots if round(k * scale) > 3)})
    realtime = config.controller.realtime.model_copy(update={"horizon": horizon, "knots": tuple(placed)})
    controller = config.controller.model_copy(update={"horizon": horizon, "realtime": realtime})
    return config.model_copy(update={"controller": controller})


def with_bandwidth(config: Config, bandwidth_rad_s: float) -> Config:
    """The same with another ω_o."""
    compensation = config.controller.compensation.model_copy(update={"bandwidth_rad_s": bandwidth_rad_s})
    controller = config.controller.model_copy(update={"compensation": compensation})
    return config.model_copy(update={"controller": controller})


def with_points(config: Config, points: int) -> Config:
    """The same with so many LEDs: the configured ones, and further ones on the plane between and around them."""
    given = config.leds.points
    random = np.random.default_rng(points)
    mixed = [random.dirichlet(np.ones(len(given))) @ given for _ in range(points - len(given))]
    placed = [*given, *(1.3 * (extra - given.mean(axis=0)) + given.mean(axis=0) for extra in mixed)]
    positions = tuple((float(x), float(y), float(z)) for x, y, z in placed)
    leds = type(config.leds).model_validate(config.leds.model_dump() | {"positions_m": positions})
    return config.model_copy(update={"leds": leds})
