"""Base, limits and controller."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from common.ceilings import (
    HARD_ACCELERATION_M_S2,
    HARD_ANGULAR_ACCELERATION_RAD_S2,
    HARD_V_MAX_M_S,
    HARD_V_MIN_M_S,
    HARD_W_MAX_RAD_S,
)
from common.config.section import NonNegative, Pair, Positive, Section


class RealtimeConfig(Section):
    """The real-time predictive controller: 3 states, piecewise linear inputs, one Gauss–Newton step per period."""

    horizon: Annotated[int, Field(ge=5, le=100)]
    knots: Annotated[
        tuple[int, ...], Field(min_length=3, description="steps at which the inputs are free, starting at 0")
    ]
    terminal_weight: Annotated[
        tuple[NonNegative, NonNegative, NonNegative], Field(description="weight of each α, each β, and θ")
    ]
    effort_weight: Annotated[Pair, Field(description="weight of v² and ω² per step")]
    rate_weight: Annotated[Pair, Field(description="weight of Δv² and Δω² per step")]
    visibility_weight: Positive
    wheel_lag_ms: NonNegative
    cruise_m_s: Annotated[float, Field(gt=0, description="speed cap of the plan, besides the limits")]
    rate_limit: Annotated[
        tuple[Positive, Positive], Field(description="caps of Δv, Δω per period, besides the limits")
    ]

    @model_validator(mode="after")
    def _knots_span_the_horizon(self) -> RealtimeConfig:
        rising = all(a < b for a, b in zip(self.knots, self.knots[1:], strict=False))
        if not rising or self.knots[0] != 0 or self.knots[-1] != self.horizon - 1:
            raise ValueError("knots must rise from 0 to horizon - 1")
        return self


class CompensationConfig(Section):
    """The paper's extended state observer, eq. (19), and the bounds of its estimate."""

    bandwidth_rad_s: Positive
    observer_input: Literal["command", "wheel"]
    initial_state: Annotated[
        Literal["measured", "observer"], Field(description="x_init: as measured, or as the observer filters it")
    ] = "observer"
    feature_bound: Annotated[float, Field(gt=0, description="bound of each feature's disturbance, 1/s")]
    theta_bound_rad_s: Positive


class ControllerConfig(Section):
    """The predictive controller: the paper's optimal control problem, eq. (28), and the real-time one."""

    method: Literal["davpc", "paper_fatrop", "paper_ipopt"]
    horizon: Annotated[int, Field(ge=5, le=100)]
    period_ms: Positive
    terminal_weight: NonNegative
    terminal_weight_theta: NonNegative
    effort_weight: Annotated[Pair, Field(description="diagonal of R: v, ω")]
    visibility_margin_px: NonNegative
    deadline_ms: Annotated[float, Field(gt=0, description="a plan that took longer is dropped")]
    solve_limit_ms: Annotated[
        float, Field(gt=0, le=60_000, description="wall time after which a solve of the paper's problem is ended")
    ] = 250.0
    realtime: RealtimeConfig
    compensation: CompensationConfig


class LimitsConfig(Section):
    """Motion limits of the Follower: those of the controller and, above them, those of the gate."""

    v_min_m_s: Annotated[float, Field(le=0, ge=HARD_V_MIN_M_S)]
    v_max_m_s: Annotated[float, Field(gt=0, le=HARD_V_MAX_M_S)]
    w_max_rad_s: Annotated[float, Field(gt=0, le=HARD_W_MAX_RAD_S)]
    controller_dv_m_s: Positive
    controller_dw_rad_s: Positive
    gate_acceleration_m_s2: Annotated[float, Field(gt=0, le=HARD_ACCELERATION_M_S2)]
    gate_angular_acceleration_rad_s2: Annotated[float, Field(gt=0, le=HARD_ANGULAR_ACCELERATION_RAD_S2)]


class BaseConfig(Section):
    """The Follower's differential drive and its battery.

    Below ``battery_low_v`` the doctor asks for a charge; below ``battery_min_v`` nothing is armed and a docking
    pauses. 0 V switches the check off.
    """

    wheel_radius_m: Annotated[float, Field(ge=0.03, le=0.30, description="every speed is as right as this")]
    track_m: Annotated[float, Field(ge=0.20, le=1.50)]
    latency_ms: NonNegative
    battery_low_v: NonNegative = 0.0
    battery_min_v: NonNegative = 0.0

    @model_validator(mode="after")
    def _charge_before_the_end(self) -> BaseConfig:
        if self.battery_low_v and self.battery_min_v > self.battery_low_v:
            raise ValueError(
                "battery_min_v is above battery_low_v: the robot would stop before the doctor asks for a charge"
            )
        return self
