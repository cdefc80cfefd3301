"""An encoder that lies stops both wheels, whatever of it lies and however slowly the robot moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from sim.can.faults import EncoderFault
from tests.rigs.canbus_rig import follower_rig
from tests.rigs.driving_rig import Driving
from tests.rigs.gate_rig import RADIUS, Bench, command, stamped, wheels

Lie = Callable[[float, float], tuple[float, float]]


def _lying(encoder: EncoderFault, lie: Lie) -> None:
    """From now on the encoder reads this of the angle since now, and of the speed."""
    began: list[float] = []

    def read(position: float, velocity: float) -> tuple[float, float]:
        began.append(position)
        angle, speed = lie(position - began[0], velocity)
        return began[0] + angle, speed

    encoder.read = read  # type: ignore[method-assign] # a fault that the bus model has no switch for


@pytest.mark.parametrize(
    ("speed_m_s", "turn_rad_s"),
    [(0.3, 0.0), (0.1, 0.0), (0.03, 0.0), (0.0, 0.3), (0.0, 0.1), (0.0, 0.05), (0.1, 0.3)],
)
@pytest.mark.parametrize(
    "lie",
    [
        lambda _, speed: (0.0, speed),
        lambda angle, speed: (-angle, speed),
        lambda angle, _: (angle, 0.0),
        lambda angle, speed: (-angle, -speed),
    ],
    ids=["angle stands", "angle runs backwards", "speed stands", "both turned"],
)
def test_a_wheel_whose_encoder_lies_stops_both(lie: Lie, speed_m_s: float, turn_rad_s: float) -> None:
    with follower_rig() as rig:
        driving = Driving(rig, speed_m_s, turn_rad_s)
        _lying(rig.robot.right_wheel.encoder, lie)
        took_ms, _ = driving.stop_ms(within=40)
        assert took_ms <= 340
        assert driving.decision.rule.startswith("measured_")
        driving.tap.close()


@pytest.mark.parametrize(
    ("speed_m_s", "turn_rad_s", "within_ms"), [(0.3, 0.0, 300), (0.1, 0.0, 300), (0.03, 0.0, 300), (0.0, 0.05, 2000)]
)
def test_an_angle_at_half_its_scale_stops_both(speed_m_s: float, turn_rad_s: float, within_ms: int) -> None:
    with follower_rig() as rig:
        driving = Driving(rig, speed_m_s, turn_rad_s)
        _lying(rig.robot.right_wheel.encoder, lambda angle, speed: (0.5 * angle, speed))
        took_ms, _ = driving.stop_ms(within=220)
        assert took_ms <= within_ms
        assert driving.decision.rule == "measured_angle"
        driving.tap.close()


def test_after_a_jump_a_new_epoch_measures_angles_from_there() -> None:
    bench = Bench()
    bench.drive(0.2)
    here = wheels(0.2, bench.now_ns)
    assert bench.step(status=replace(here, left_rad=50.0, right_rad=50.0)).rule == "measured_jump"
    bench.standing = {"epoch": 8}
    for n in range(200):
        driven_rad = 50.0 + 0.01 * bench.v / RADIUS * (n + 1)
        status = replace(wheels(0.0, bench.now_ns), left_rad=driven_rad, right_rad=driven_rad)
        order = stamped(command(0.0, 0.0, n + 1, bench.now_ns, epoch=8))
        assert bench.step(order, status=status).rule == "", n
