"""Another setting on recorded inputs, side by side."""

from __future__ import annotations

import math

import pytest

from common.config import with_overrides
from common.errors import ConfigError
from common.recording.recording import Recording
from station.replay.what_if import FieldTrace, as_table, chosen_overrides, side_by_side
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.recorded_run import recorded_run


def test_the_same_setting_differs_nowhere_and_a_slower_one_does() -> None:
    recording = Recording.read(recorded_run())
    recording = Recording(recording.path.with_name("elsewhere.mcap"), recording.topics, recording.notes)
    same = side_by_side(recording, recording.config, CONFIG_PATH)
    assert [trace.name for trace in same] == ["v_m_s", "w_rad_s"]
    assert all(trace.row()["largest_difference"] == 0.0 for trace in same)
    assert all(trace.row()["recorded"] > 50 for trace in same)
    slow = with_overrides(recording.config, ["controller.realtime.rate_limit=[0.001, 0.05]"], "test")
    v = side_by_side(recording, slow, CONFIG_PATH)[0].row()
    assert v["largest_difference"] > 0.01
    assert v["rms_other"] < v["rms_recorded"]


def test_a_method_brings_its_estimate_with_it() -> None:
    assert chosen_overrides("", ["a.b=1"]) == ["a.b=1"]
    assert chosen_overrides("paper", []) == ['controller.method="paper_fatrop"', 'estimator.method="paper"']
    config = Recording.read(recorded_run()).config
    with pytest.raises(ConfigError, match=r"run\.mcap: controller\.method"):
        with_overrides(config, chosen_overrides("magic", []), "run.mcap")


def test_a_table_names_what_has_no_number() -> None:
    trace = FieldTrace("controller", "v_m_s", [1.0], [0.1], [math.nan])
    assert "| controller | v_m_s | – |" in as_table([trace])
