"""A recorded docking replayed: to the bit, or the first difference by field."""

from __future__ import annotations

import math

import pytest

from common.config import Config
from common.recording.recording import Recording
from station.replay.compare import differing, judge
from station.replay.core import CORES
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.recorded_run import recorded_run


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording.read(recorded_run())


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("fresh", [False, True])
def test_every_core_is_bit_identical(recording: Recording, core: str, fresh: bool) -> None:
    again = Recording(recording.path, recording.topics, recording.notes)  # frames are read forward, once
    verdict = judge(core, again, recording.config, CONFIG_PATH, fresh=fresh)
    assert verdict.identical, verdict.summary()
    assert verdict.skipped == 0
    assert verdict.outputs > 50


def with_effort(config: Config, weight: tuple[float, float]) -> Config:
    realtime = config.controller.realtime.model_copy(update={"effort_weight": weight})
    return config.model_copy(update={"controller": config.controller.model_copy(update={"realtime": realtime})})


def test_a_gain_changed_by_one_ulp_is_named_by_the_first_field(recording: Recording) -> None:
    v, w = recording.config.controller.realtime.effort_weight
    changed = with_effort(recording.config, (math.nextafter(v, 1.0), w))
    verdict = judge("controller", recording, changed, CONFIG_PATH, fresh=True)
    assert not verdict.identical
    assert verdict.first is not None
    assert verdict.first.what.startswith("follower/motion/command: ")
    assert any("first difference: step" in line for line in verdict.summary())


def test_fields_that_differ_are_named_with_their_place() -> None:
    before = {"a": (1.0, {"b": 2}), "c": 3}
    assert list(differing(before, {"a": (1.0, {"b": 5}), "c": 3})) == [("a[1].b", 2, 5)]
    assert list(differing(before, {"a": (1.0,), "c": 3})) == [("a", (1.0, {"b": 2}), (1.0,))]
