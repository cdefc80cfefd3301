"""The Follower's eleven drives, made from the configuration: modes, ramps, limits, names."""

from __future__ import annotations

import math

from common.canopen.cia402 import Mode
from common.ceilings import HARD_WHEEL_SPEED_M_S
from common.config import BaseConfig, FollowerCanConfig
from follower.can_bridge.axes import Axis, Parameter

_ARM_NAMES = (
    *((side, f"joint {n}") for side in ("left", "right") for n in (1, 2, 3)),
    ("left", "gripper"),
    ("right", "gripper"),
)


def make_axes(config: FollowerCanConfig, base: BaseConfig) -> tuple[Axis, ...]:
    """All drives in the order wheels, joints, grippers, lift."""
    left = Axis("left wheel", config.left_wheel, "wheels", Mode.PROFILE_VELOCITY)
    right = Axis("right wheel", config.right_wheel, "wheels", Mode.PROFILE_VELOCITY)
    for wheel in (left, right):
        wheel.extra = _wheel_ramps(wheel, config, base)
    torque = [
        Axis(f"{side} {part}", drive, "arms", Mode.PROFILE_TORQUE)
        for (side, part), drive in zip(_ARM_NAMES, (*config.joints, *config.grippers), strict=True)
    ]
    lift = Axis("lift", config.lift, "arms", Mode.PROFILE_POSITION, units_per_turn=config.lift_lead_m)
    lift.extra = _lift_ramps(lift, config)
    return (left, right, *torque, lift)


def make_homing_axes(config: FollowerCanConfig, base: BaseConfig) -> tuple[Axis, ...]:
    """The same, with axes that have to be homed in mode 6 (CiA 402)."""
    axes = make_axes(config, base)
    for axis in axes:
        homing = axis.config.homing
        if homing is not None:
            per_unit = abs(axis.counts_per_unit)
            axis.mode = Mode.HOMING
            axis.extra = (
                (0x6098, 0, homing.method),
                (0x6099, 1, round(homing.search_speed * per_unit)),
                (0x6099, 2, round(homing.zero_speed * per_unit)),
                (0x609A, 0, round(homing.acceleration * per_unit)),
                *(parameter for parameter in axis.extra if parameter[0] == 0x6085),
            )
    return axes


def _wheel_ramps(wheel: Axis, config: FollowerCanConfig, base: BaseConfig) -> tuple[Parameter, ...]:
    per_metre = abs(wheel.counts_per_unit) / base.wheel_radius_m
    ramp = round(config.wheel_ramp_m_s2 * per_metre)
    limit = (0x607F, 0, math.ceil(HARD_WHEEL_SPEED_M_S * per_metre))
    # turning adds to driving: speeding up may use both, stopping is what docs/safety.md relies on
    return (limit, (0x6083, 0, 2 * ramp), (0x6084, 0, ramp), (0x6085, 0, ramp))


def _lift_ramps(lift: Axis, config: FollowerCanConfig) -> tuple[Parameter, ...]:
    speed = round(config.lift_speed_m_s * abs(lift.counts_per_unit))
    acceleration = round(config.lift_acceleration_m_s2 * abs(lift.counts_per_unit))
    return ((0x6081, 0, speed), *((index, 0, acceleration) for index in (0x6083, 0x6084, 0x6085)))
