"""An operator's commands to robots that run in another terminal."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.rigs.sim_run import judged_on_a_calm_host
from tests.rigs.station_rig import davpc


@pytest.mark.alone
@judged_on_a_calm_host(stepped="tests/stepped/test_operator.py::test_an_operator_asks_and_stops_a_docking_under_way")
def test_an_operator_sees_asks_and_stops_a_docking_under_way(sim_run: Any) -> None:
    run = sim_run("--start", "9,0.3,0", "--set", "supervisor.approach_speed_m_s=0.1")
    run.wait_for("approach")
    here = ("--runtime", str(run.runtime()))
    printed = davpc("dock", "status", "--json", *here)
    assert printed.returncode == 0, printed.stderr
    status = json.loads(printed.stdout)
    assert (status["follower"]["phase"], status["leader"]["lock"]) == ("approach", "open")
    dimmed = davpc("led", "set", "0.9", "--led", "2", *here)
    assert dimmed.returncode == 0, dimmed.stderr
    assert dimmed.stdout.strip().endswith("1.00, 1.00, 0.90, 1.00 A")
    again = davpc("dock", "start", *here)
    assert again.returncode == 1
    assert "phase approach is under way" in again.stderr
    kept = davpc("lock", "close", "--json", *here)
    assert (kept.returncode, kept.stdout != "") == (1, True), kept.stderr
    assert json.loads(kept.stdout) == {"outcome": "refused", "reason": "no beam in the guide"}
    stopped = davpc("dock", "abort", *here)
    assert (stopped.returncode, stopped.stdout.strip()) == (0, "done: aborted"), stopped.stderr
    assert run.finish() == 1
    assert run.results()["cause"] == "operator_abort"
