"""A soak's table, and that an interrupted one goes on; one short shift with all processes in stepped time."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.config import Config
from experiments.shared.executor import ALONE
from experiments.soak import experiment, shift
from experiments.soak.experiment import counted, memory_slope, shifts
from experiments.soak.shift import UNNAMED, Docked, Shift, Worked


def docked(*ends: str, counted: bool = False, unsafe: tuple[str, ...] = ()) -> Docked:
    return Docked(
        seed=3, trolley=1, fault="abort", phase="push", ends=list(ends), unsafe=list(unsafe), counted=counted
    )


def test_trolleys_are_counted_by_their_tries_and_ends() -> None:
    trolleys = [
        docked("done"),
        docked("leds_lost: 3", "done"),
        docked("gate_stop: x", counted=True),
        docked("slip", "slip", "slip"),
    ]
    metrics = counted(trolleys)
    assert metrics == {
        "docked": 3, "docked_share": 0.75, "first_try_share": 0.5, "tries": 1.75, "unsafe": 0, "unnamed": 0,
    }  # fmt: skip
    assert counted([docked(UNNAMED)])["unnamed"] == 1
    assert docked("done", unsafe=("stale command, try 1",)).wrong == [
        "seed 3, trolley 1, abort push: stale command, try 1"
    ]


def test_the_memory_of_a_short_shift_is_not_judged_and_that_of_a_long_one_by_its_slope() -> None:
    assert memory_slope(Worked(memory=[(100.0, 100.0), (200.0, 130.0)])) is None
    warm = [(400.0 + 100 * k, 150.0 + k / 36) for k in range(6)]
    slope = memory_slope(Worked(memory=[(100.0, 50.0), (200.0, 130.0), (300.0, 140.0), *warm]))
    assert slope == pytest.approx(1.0)


def test_shifts_share_the_hours_and_have_seeds_of_their_own(config: Config) -> None:
    long = shifts(config, 2, 24.0)
    assert sum(job.seconds for job in long) == pytest.approx(24 * 3600)
    assert len({job.seed for job in (*long, *shifts(config, 3, 24.0))}) == 96
    assert [job.seconds for job in shifts(config, 1, 0.1)] == [360.0]


def test_an_interrupted_soak_goes_on_and_one_end_without_a_name_fails_it(
    monkeypatch: pytest.MonkeyPatch, config: Config, tmp_path: Path
) -> None:
    done: list[int] = []

    def fake(job: Shift) -> Worked:
        if len(done) == 2:
            done.append(0)
            raise KeyboardInterrupt
        done.append(job.seed)
        return Worked(trolleys=[docked("done")], seconds=job.seconds, memory=[(1800.0, 100.0)])

    monkeypatch.setattr(experiment, "work", fake)
    with pytest.raises(KeyboardInterrupt):
        experiment.run(tmp_path, 1, ALONE, config, 2.0)
    (torn,) = (tmp_path / "unfinished").glob("shift-100001-*")
    torn.write_bytes(torn.read_bytes()[:-20])
    results = experiment.run(tmp_path, 1, ALONE, config, 2.0)
    assert done == [100_000, 100_001, 0, 100_001, 100_002, 100_003]
    assert results["settings"]["missed"] == []
    assert results["settings"]["causes"] == {"done": 4}
    assert results["rows"][0]["metrics"]["docked_share"] == 1.0
    assert not (tmp_path / "unfinished").exists()
    monkeypatch.setattr(experiment, "work", lambda _shift: Worked(trolleys=[docked(UNNAMED)], seconds=1.0))
    assert len(experiment.run(tmp_path, 1, ALONE, config, 0.01)["settings"]["missed"]) == 1


def test_a_shift_runs_all_processes_and_names_the_end_that_a_fault_brings(
    monkeypatch: pytest.MonkeyPatch, config: Config
) -> None:
    monkeypatch.setattr(shift, "TRIES", 1)
    worked = shift.work(Shift(config_text=config.model_dump_json(), seed=450, seconds=1.0))
    (trolley,) = worked.trolleys
    assert (trolley.fault, trolley.phase, trolley.ends, trolley.wrong) == ("abort", "acquire", ["operator_abort"], [])
    assert not trolley.docked
    assert worked.seconds > 1.0
    assert len(worked.memory) == 1
