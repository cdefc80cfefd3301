"""What the bus reads becomes a value in its range, or a named cause; never an error of its own."""

from __future__ import annotations

import struct

import pytest

from common.config import load_config
from follower.can_bridge.inbound import StopModule
from follower.can_bridge.robot_axes import make_axes
from tests.rigs.canbus_rig import CONFIG_PATH


@pytest.mark.parametrize(
    ("raw", "volts"),
    [
        (2400, 24.0),
        (0, 0.0),
        (-50, 0.0),
        (20_000, 200.0),
        (20_001, None),
        (0x7FFF, None),
        (-101, None),
        (-0x8000, None),
    ],
)
def test_a_voltage_that_no_battery_has_is_not_read(raw: int, volts: float | None) -> None:
    module = StopModule(40)
    module.expected = 1
    assert module.handle_pdo(struct.pack("<Bh", 3, raw), 1)
    assert module.battery_v == (None if volts is None else pytest.approx(volts))
    assert module.status_ns == 1


def test_a_torque_that_no_axis_has_is_no_genuine_frame() -> None:
    config = load_config(CONFIG_PATH)
    strong = config.follower_can.joints[0].model_copy(update={"rated_torque_n_m": 1000.0, "gear_ratio": 1000.0})
    can = config.follower_can.model_copy(update={"joints": (strong, *config.follower_can.joints[1:])})
    axis = next(axis for axis in make_axes(can, config.base) if axis.config is strong)
    for permille, genuine in ((0, True), (0x7FFF, False), (-0x8000, False)):
        axis.synchronised()
        assert axis.handle_pdo(0, struct.pack("<Hih", 0x0237, 0, permille), 1) == genuine
    assert axis.torque_n_m == 0.0
