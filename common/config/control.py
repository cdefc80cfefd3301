"""Base, limits and controller."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from common.config.section import NonNegative, Pair, Positive, Section


class RealtimeConfig(Section):
    """The real-time predictive controller: 3 states, inputs linear between knots, one Gauss–Newton step a period."""

    horizon: Annotated[int, Field(ge=5, le=100)]
    knots: Annotated[tuple[int, ...], Field(min_length=3, description="steps at which inputs are free, from 0")]
    terminal_weight: Annotated[tuple[float, float, float], Field(description="of each α, each β, and θ")]
    effort_weight: Annotated[Pair, Field(description="of v² and ω², each step")]
    rate_weight: Annotated[Pair, Field(description="of Δv² and Δω², each step")]
    visibility_weight: Positive
    wheel_lag_ms: NonNegative
    cruise_m_s: Annotated[float, Field(gt=0, description="speed that is never exceeded, also below the limit")]
    rate_limit: Annotated[tuple[Positive, Positive], Field(description="Δv, Δω a period, also below the limit")]

    @model_validator(mode="after")
    def _knots_span_the_horizon(self) -> RealtimeConfig:
        rising = all(a < b for a, b in zip(self.knots, self.knots[1:], strict=False))
        if not rising or self.knots[0] != 0 or self.knots[-1] != self.horizon - 1:
            raise ValueError("knots rise from 0 to horizon - 1")
        return self


class CompensationConfig(Section):
    """The paper's extended state observer and what bounds its estimate."""

    bandwidth_rad_s: Positive
    observer_input: Literal["command", "wheel"]
    feature_bound: Annotated[float, Field(gt=0, description="of the disturbance of each feature, 1/s")]
    theta_bound_rad_s: Positive


class ControllerConfig(Section):
    """The predictive problem of the paper, eq. (28)."""

    method: Literal["davpc", "paper_fatrop", "paper_ipopt"]
    horizon: Annotated[int, Field(ge=5, le=100)]
    period_ms: Positive
    terminal_weight: NonNegative
    terminal_weight_theta: NonNegative
    effort_weight: Annotated[Pair, Field(description="R of v and ω")]
    visibility_margin_px: NonNegative
    deadline_ms: Positive
    realtime: RealtimeConfig
    compensation: CompensationConfig


class LimitsConfig(Section):
    """What the Follower may do: bounds of the controller and, above them, of the gate."""

    v_min_m_s: Annotated[float, Field(le=0, ge=-0.2)]
    v_max_m_s: Annotated[float, Field(gt=0, le=0.6)]
    w_max_rad_s: Annotated[float, Field(gt=0, le=0.8)]
    controller_dv_m_s: Positive
    controller_dw_rad_s: Positive
    gate_acceleration_m_s2: Annotated[float, Field(gt=0, le=0.6)]
    gate_angular_acceleration_rad_s2: Annotated[float, Field(gt=0, le=2.5)]


class BaseConfig(Section):
    """The Follower's differential drive, and its battery: 0 V as a bound means that it is not judged.

    Below ``battery_low_v`` the doctor asks for a charge; below ``battery_min_v`` nothing is armed, a docking pauses.
    """

    wheel_radius_m: Positive
    track_m: Positive
    latency_ms: NonNegative
    battery_low_v: NonNegative = 0.0
    battery_min_v: NonNegative = 0.0

    @model_validator(mode="after")
    def _charge_before_the_end(self) -> BaseConfig:
        if self.battery_low_v and self.battery_min_v > self.battery_low_v:
            raise ValueError("battery_min_v is above battery_low_v: it would stop before it asks for a charge")
        return self
