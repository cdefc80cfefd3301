"""A report names what was injected, from the recording alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from common.recording.recording import Recording
from station.report.attempt import RecordedAttempt
from station.report.explanation import evidence, headline
from tests.rigs.recorded_run import Rig, record, recording_config
from tests.rigs.station_rig import davpc_in_process


def halted(name: str) -> Callable[[Rig], None]:
    return lambda rig: rig.executor.halt(name)


def silent(rig: Rig) -> None:
    rig.follower.bus.faults.silent.add(rig.follower.left_wheel.node_id)


def bus_off(rig: Rig) -> None:
    rig.follower.bus.faults.bus_off = True


def dark(rig: Rig) -> None:
    rig.plant.leader.faults.dead_leds.update({0, 1, 2})


def leader_off(rig: Rig) -> None:
    rig.plant.leader.faults.powered = False
    rig.executor.halt("leader")


INJECTED: dict[str, tuple[Callable[[Rig], None], str, str]] = {
    "camera": (halted("follower-camera"), "camera_silent", "nothing from follower-camera"),
    "estimator": (halted("follower-estimator"), "estimator_silent", "nothing from follower-estimator"),
    "controller": (halted("follower-controller"), "controller silent", "nothing from follower-controller"),
    "arms": (halted("follower-arms"), "arms silent", "nothing from follower-arms"),
    "bridge": (halted("follower-can-bridge"), "drives_silent", "nothing from follower-can-bridge"),
    "wheel": (silent, "node_silent", "left wheel: node 1 is silent"),
    "bus": (bus_off, "bus_lost", "bus-off"),
    "estop": (lambda rig: rig.follower.set_stop_inputs(False, True), "stop_input", "emergency stop"),
    "leds": (dark, "leds_lost", "LED 0 draws 0.00 A"),
    "leader": (leader_off, "leader_lost", "nothing from leader (leader/state)"),
}


@pytest.mark.parametrize("name", INJECTED)
def test_the_injected_cause_is_named(tmp_path: Path, name: str) -> None:
    fault, cause, shown = INJECTED[name]
    quick = ("supervisor.lost_timeout_s=2.0", "supervisor.search_turn_deg=5.0", "supervisor.acquire_timeout_s=6.0")
    path = record(tmp_path / "run.mcap", recording_config(*quick), 40.0, fault=fault, fault_s=5.0)
    attempt = RecordedAttempt(Recording.read(path))
    assert attempt.complete
    assert cause in attempt.cause, (attempt.cause, evidence(attempt))
    assert any(shown in line for line in (*evidence(attempt), *headline(attempt))), (attempt.cause, evidence(attempt))
    assert any(line.startswith("Do: ") for line in headline(attempt))


def test_a_page_is_one_file_without_references(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", recording_config(), 12.0, fault=INJECTED["estop"][0], fault_s=5.0)
    page = tmp_path / "report.html"
    done = davpc_in_process("report", str(path), "--html", str(page), "--against", str(path))
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert "Means: emergency or protective stop" in text
    assert text.count("<svg") == 3
    assert "data:image/jpeg;base64," in text
    assert "http://" not in text.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )
    assert 'src="data:' in text
    assert "prefers-color-scheme: dark" in text


def test_a_recording_without_a_docking_and_a_missing_one_are_one_line(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", recording_config(), 0.5)
    done = davpc_in_process("report", str(path))
    assert done.returncode == 2
    assert done.stderr.strip().endswith("run.mcap: holds no docking")
    done = davpc_in_process("report", "last", "--state", str(tmp_path))
    assert "recordings: no recordings" in done.stderr
