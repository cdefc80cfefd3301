"""Our code is recognised within two seconds; other codes, lamps and flicker never are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from common.config import LedCodeConfig
from common.led_code import CODES, level
from common.timing import NS_PER_MS, NS_PER_S
from follower.estimator.identity.code_receiver import CodeReceiver, CodeVerdict

OURS = LedCodeConfig(number=3)
RATE_HZ = 60.0
Light = Callable[[float], float]


def shown(number: int, phase_s: float = 0.0, depth: float = 0.4) -> Light:
    """The light of a Leader that steps at 50 Hz."""
    step_ns = 20 * NS_PER_MS

    def light(t_s: float) -> float:
        time_ns = round((t_s + phase_s) * NS_PER_S) // step_ns * step_ns
        return level(number, OURS.symbol_ms * NS_PER_MS, depth, time_ns)

    return light


def received(
    light: Light, seed: int = 0, seconds: float = 2.0, noise: float = 0.05, dropped: float = 0.0, leds: int = 4
) -> tuple[CodeVerdict, CodeReceiver]:
    """What a receiver makes of a light that is seen from ever nearer."""
    draws = np.random.default_rng(seed)
    receiver = CodeReceiver(OURS, RATE_HZ)
    verdict: CodeVerdict = "unknown"
    for frame in range(round(seconds * RATE_HZ)):
        t_s = (frame + 1) / RATE_HZ
        if draws.random() < dropped:
            continue
        mass = 1000.0 * light(t_s) / (8.0 - 0.3 * t_s) ** 2 * np.exp(draws.normal(0.0, noise, leds))
        verdict = receiver.take(round(t_s * NS_PER_S), mass)
    return verdict, receiver


@pytest.mark.parametrize("dropped", [0.0, 0.3])
@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_our_code_is_recognised_within_two_seconds_at_any_phase(noise: float, dropped: float) -> None:
    for seed in range(20):
        phase_s = 1.86 * seed / 20
        verdict, receiver = received(shown(OURS.number, phase_s), seed, noise=noise, dropped=dropped)
        assert verdict == "own", (phase_s, receiver.correlation)


def test_saturation_that_leaves_a_tenth_of_the_modulation_does_not_matter() -> None:
    assert received(shown(OURS.number, depth=0.04), noise=0.01)[0] == "own"


def test_every_other_code_is_refused() -> None:
    for number in set(range(CODES)) - {OURS.number}:
        verdict, receiver = received(shown(number, 0.05 * number), number)
        assert verdict == "other", (number, receiver.correlation)


@pytest.mark.parametrize("hz", [0.0, 0.5, 2.3, 5.0, 8.3, 49.7, 50.0, 60.0, 100.0, 120.0])
def test_lamps_that_flicker_are_refused(hz: float) -> None:
    for seed in range(5):
        assert received(lambda t: 1.0 - 0.5 * float(np.sin(np.pi * hz * t)) ** 2, seed)[0] != "own"


def test_one_light_at_random_beside_three_that_carry_the_code_is_refused() -> None:
    """One spot of the four is not a LED of ours."""
    draws, ours = np.random.default_rng(5), shown(OURS.number)
    receiver = CodeReceiver(OURS, RATE_HZ)
    verdicts = set()
    for frame in range(240):
        t_s = (frame + 1) / RATE_HZ
        mass = np.array([*[1000.0 * ours(t_s)] * 3, 1000.0 * draws.uniform(0.6, 1.0)])
        verdicts.add(receiver.take(round(t_s * NS_PER_S), mass))
    assert "own" not in verdicts


def test_an_array_that_stops_carrying_the_code_is_noticed_within_a_period() -> None:
    ours, theirs = shown(OURS.number), shown(OURS.number + 1)
    verdict, _ = received(lambda t: ours(t) if t < 3.0 else theirs(t), seconds=3.0)
    assert verdict == "own"
    verdict, _ = received(lambda t: ours(t) if t < 3.0 else theirs(t), seconds=5.0)
    assert verdict == "other"


def test_a_hidden_led_does_not_matter_and_two_leds_are_too_few() -> None:
    ours = shown(OURS.number)
    for hidden, expected in ((1, "own"), (2, "unknown")):
        receiver = CodeReceiver(OURS, RATE_HZ)
        for frame in range(150):
            t_s = (frame + 1) / RATE_HZ
            mass = np.full(4, 1000.0 * ours(t_s))
            mass[:hidden] = np.nan
            receiver.take(round(t_s * NS_PER_S), mass)
        assert receiver.verdict == expected
