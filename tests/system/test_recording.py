"""A docking of real processes, recorded, replays to the bit."""

from __future__ import annotations

from typing import Any

import pytest

from tests.rigs.station_rig import davpc_in_process

pytestmark = pytest.mark.alone


@pytest.mark.stepped_twin("tests/unit/station/replay/test_compare.py::test_every_core_is_bit_identical")
def test_real_processes_replay_to_the_bit(sim_run: Any) -> None:
    run = sim_run("--record", "--start", "2.0,0.05,1")
    assert run.finish() == 0, "".join(run.lines)
    replayed = davpc_in_process(
        "replay", str(run.out / "run.mcap"), "--core", "controller,supervisor,gate,arms,leader"
    )
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert replayed.stdout.count("bit-identical") == 5
