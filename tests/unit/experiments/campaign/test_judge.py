"""What counts as a reaction, as unsafe and as late: on made-up traces."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.config import Config
from common.timing import NS_PER_MS, NS_PER_S
from experiments.campaign.judge import Verdict, judge, reaction_of
from experiments.campaign.rows import ROWS
from experiments.campaign.trace import (
    BusSample,
    CommandSample,
    DrivesSample,
    MissionSample,
    Trace,
    WorldSample,
)

FAULT_NS = 10 * NS_PER_S
SPEED = 0.3


def bus(stop_ms: float | None = None, disarm_ms: float | None = None, seconds: float = 2.0) -> list[BusSample]:
    """A sample every 10 ms: driving ahead, until a stop, until the arms are no longer led."""
    samples = []
    for k in range(round(100 * seconds) + 1):
        ms = 10 * k
        moving = stop_ms is None or ms < stop_ms
        on = disarm_ms is None or ms < disarm_ms
        samples.append(BusSample(FAULT_NS + ms * NS_PER_MS, SPEED if moving else 0.0, 0.0, on, on))
    return samples


def world(stop_ms: float | None, seconds: float = 2.0) -> list[WorldSample]:
    """Braking at 0.5 m/s² from the stop on."""
    samples, x_m = [], -3.0
    for k in range(round(100 * seconds) + 1):
        ms = 10.0 * k
        braked = 0.0 if stop_ms is None else max(0.0, ms - stop_ms) / 1000 * 0.5
        v_m_s = max(0.0, SPEED - braked)
        x_m += v_m_s / 100
        stamp = FAULT_NS + round(ms) * NS_PER_MS
        samples.append(WorldSample(stamp, x_m, 0.0, 0.0, v_m_s, 0.0, True, 20.0, 0.0, False, True))
    return samples


def trace(stop_ms: float | None = None, disarm_ms: float | None = None, cause: str = "command_age") -> Trace:
    """An approach that is stopped."""
    made = Trace(fault_ns=FAULT_NS, bus=bus(stop_ms, disarm_ms), world=world(stop_ms))
    made.missions = [MissionSample(FAULT_NS, "approach", True, "", "")]
    made.commands = [CommandSample(FAULT_NS + k * 50 * NS_PER_MS, SPEED, 0.0) for k in range(-4, 40)]
    if stop_ms is not None:
        reported_ms = stop_ms if disarm_ms is None else disarm_ms
        made.drives = [DrivesSample(FAULT_NS + round(reported_ms) * NS_PER_MS, "stopped", cause)]
    return made


def judged(what: Trace, row: str = "S01", phase: str = "approach", config: Config | None = None) -> Verdict:
    """The verdict beside an undisturbed run."""
    assert config is not None
    return judge(ROWS[row], phase, "made up", 1, what, bus(), config)


@pytest.mark.parametrize(
    ("stop_ms", "disarm_ms", "refused", "expected"),
    [
        (None, None, "", ("none", None)),
        (120, None, "", ("S0", 120)),
        (120, 1500, "", ("S0", 120)),
        (120, 130, "", ("S1", 120)),
        (30, 40, "stopped by stop_input: reset first", ("S2", 30)),
    ],
)
def test_the_bus_tells_the_reaction(
    stop_ms: float | None, disarm_ms: float | None, refused: str, expected: tuple[str, float | None]
) -> None:
    what = replace(trace(stop_ms, disarm_ms), refused=refused)
    assert reaction_of(what, bus()) == expected


def test_a_stop_that_is_reported_as_disarmed_is_one_though_the_arms_are_led_until_standstill() -> None:
    led = replace(trace(120, 900), drives=trace(120, 130).drives)
    assert reaction_of(led, bus()) == ("S1", 120)
    assert reaction_of(replace(led, bus=bus(120)), bus()) == ("S0", 120)


def test_a_stop_that_comes_without_the_fault_too_is_no_reaction() -> None:
    assert reaction_of(trace(300, None), bus(300, None)) == ("none", None)


def test_a_right_stop_is_right(config: Config) -> None:
    verdict = judged(trace(120, 130), config=config)
    assert verdict.right, verdict.text


def test_what_is_late_or_otherwise_is_named(config: Config) -> None:
    assert judged(trace(180, 190), config=config).late
    assert judged(trace(120, None), config=config).wrong_reaction
    assert judged(trace(120, 130, cause="slip"), config=config).wrong_cause
    assert not judged(trace(120, 130), row="S03", config=config).right


def test_motion_after_the_brake_time_is_unsafe(config: Config) -> None:
    what = trace(120, 130)
    what.world = [sample._replace(v_m_s=SPEED) for sample in what.world]
    assert "speed while stopped" in judged(what, config=config).unsafe


def test_wheels_that_follow_a_command_older_than_120_ms_are_unsafe(config: Config) -> None:
    what = trace(None, None)
    what.commands = what.commands[:4]
    assert "stale command" in judged(what, config=config).unsafe


def test_a_lost_trolley_an_opened_lock_and_a_speed_beyond_the_cap_are_unsafe(config: Config) -> None:
    lost = trace(120, 130)
    lost.world[50:] = [sample._replace(holding=False) for sample in lost.world[50:]]
    assert "released in contact" in judged(lost, config=config).unsafe
    opened = trace(120, 130)
    opened.world = [sample._replace(locked=True, travel=1.0 - 0.001 * k) for k, sample in enumerate(opened.world)]
    assert "unlocked" in judged(opened, config=config).unsafe
    fast = trace(None, None)
    fast.missions = [MissionSample(FAULT_NS, "push", True, "", "")]
    assert "beyond the cap" in judged(fast, phase="push", config=config).unsafe


def test_motion_on_a_frozen_image_is_unsafe(config: Config) -> None:
    what = trace(None, None)
    what.blind_ns = FAULT_NS
    assert "moved without a living image" in judged(what, row="S08", config=config).unsafe


def test_nothing_may_be_armed_from_idle(config: Config) -> None:
    assert judged(trace(0, 0), row="S45", phase="idle", config=config).wrong_reaction is False
    assert judged(trace(None, None), row="S45", phase="idle", config=config).wrong_reaction is True
