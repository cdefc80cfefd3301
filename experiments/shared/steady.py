"""Robots without a light code, for what is measured frame by frame under steady light."""

from __future__ import annotations

from common.config import Config


def steady(config: Config) -> Config:
    """The same robots with LEDs that shine steadily."""
    return config.model_copy(update={"leds": config.leds.model_copy(update={"code": None})})
