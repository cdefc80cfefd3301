"""Guide, lock and LED driver of the Leader."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from common.config.section import NonNegative, Positive, Section


class LeaderConfig(Section):
    """Guide, lock and LED driver of the Leader."""

    lock_travel_timeout_s: Positive
    lock_travel_least_s: Annotated[
        NonNegative, Field(description="shortest travel: a switch that closes sooner is stuck")
    ] = 0.5
    actuator_current_limit_a: Positive
    led_current_tolerance_a: Positive
    led_rated_current_a: Annotated[Positive, Field(description="continuous current rating of an LED")]
    led_max_current_a: Annotated[float, Field(gt=0, le=5, description="largest current that may be requested")]
    led_thermal_s: Annotated[Positive, Field(description="thermal time constant of an LED")]

    @model_validator(mode="after")
    def _travel_in_time(self) -> LeaderConfig:
        if self.lock_travel_least_s >= self.lock_travel_timeout_s:
            raise ValueError("lock_travel_least_s must be less than lock_travel_timeout_s")
        return self
