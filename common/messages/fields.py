"""Types of message fields: ranges of numbers, values of names."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import ConfigDict, Field

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
Count = Annotated[int, Field(ge=0, lt=2**63)]
Ns = Count
Angle = Annotated[float, Field(ge=-7.0, le=7.0)]
Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Speed = Annotated[float, Field(ge=-10.0, le=10.0)]
# more than 32-bit counts of any configurable encoder can be: rad, rad/s or m
Measured = Annotated[float, Field(ge=-1e11, le=1e11)]
# more than any configurable bound of the estimate
Disturbance = Annotated[float, Field(ge=-1e10, le=1e10)]
Torque = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Text = Annotated[str, Field(max_length=400)]
RequestId = Annotated[str, Field(min_length=1, max_length=100)]
Point2 = tuple[float, float]
Phase = Literal[
    "idle",
    "staging",
    "acquire",
    "search",
    "approach",
    "insert",
    "push",
    "lock",
    "release",
    "retract",
    "done",
    "aborted",
    "manual",
]
PHASES: tuple[Phase, ...] = get_args(Phase)
StateCause = Literal[
    "ok",
    "no_frame",
    "stale_frame",
    "bad_frame",
    "frozen_camera",
    "not_following",
    "overexposed",
    "underexposed",
    "noisy",
    "few_leds",
    "not_identified",
    "ambiguous",
    "confirming",
    "wrong_array",
    "residual",
    "coasting",
    "behind_camera",
]
ArmCause = Literal["ok", "slip", "collision"]
GuideState = Literal["down", "lifted", "seated"]
LockState = Literal["open", "closing", "locked", "opening", "fault"]
Outcome = Literal["done", "accepted", "refused", "expired"]
