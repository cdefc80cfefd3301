"""What can be injected, by name: a function of the stage, called at the moment at which the fault begins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from experiments.campaign.faults import bus, image, intruder, message
from experiments.campaign.stage import Stage

Fault = Callable[[Stage], None]
FAULTS: dict[str, Fault] = {**bus.FAULTS, **image.FAULTS, **message.FAULTS, **intruder.FAULTS}
OVERRIDES: dict[str, dict[str, Any]] = {
    "calibration_missing": {"camera.calibration": "/nonexistent/of-another-camera.toml"},
}
hide_leds = image.hide_leds
