"""The way of an image to the CAN bus."""

from __future__ import annotations

import pytest

from common.recording.recording import Recording
from common.timing import NS_PER_MS
from sim.stepped import DURATION_NS, TRANSPORT_DELAY_NS
from station.export.latency import HOPS, LatencyTrace, as_table, of_recording
from tests.rigs.recorded_run import recorded_run
from tests.rigs.station_rig import davpc_in_process


def test_hops_are_those_that_stepped_time_has() -> None:
    hops = of_recording(Recording.read(recorded_run())).hops_ms()
    estimator = (DURATION_NS["follower-estimator"] + TRANSPORT_DELAY_NS) / NS_PER_MS
    controller = (DURATION_NS["follower-controller"] + TRANSPORT_DELAY_NS) / NS_PER_MS
    assert len(hops["frame → state"]) > 50
    assert hops["frame → state"][-1] == pytest.approx(estimator, abs=0.01)
    assert hops["state → command"][-1] == pytest.approx(controller, abs=0.01)
    for whole, *parts in zip(hops[HOPS[-1]][-3:], *(hops[name][-3:] for name in HOPS[:-1]), strict=True):
        assert whole == pytest.approx(sum(parts))
    assert "| image → CAN |" in as_table(hops)


def test_a_command_whose_frame_is_unknown_counts_nowhere() -> None:
    assert LatencyTrace().passages() == []


def test_the_command_line_shows_the_table() -> None:
    done = davpc_in_process("trace", str(recorded_run()))
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in HOPS)
