"""What the incidents of the collection count as right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from common.causes import CAUSES
from experiments.queues import incidents
from experiments.queues.incident_cases import CASES
from experiments.queues.incidents import End, is_right, report_agrees
from experiments.queues.run import Docking
from follower.supervisor.transitions import ACTIVE
from station.experiment import experiment


def test_every_expected_cause_is_one_that_exists() -> None:
    assert {end for case in CASES.values() for end in case.ends} - {"done"} <= set(CAUSES)


GOOD = End(
    "leader_lost", "leader_lost: in contact", still=True, held=True, latched_rightly=True, happened=True,
    reported=True, armed=True, paused="", searches=0, rearmed=0, slow=True, phases=("push",),
)  # fmt: skip
WRONG = ("still", "held", "latched_rightly", "happened", "reported", "slow")


def test_an_incident_ends_rightly_only_at_standstill_with_its_cause_its_report_and_its_grip() -> None:
    case = CASES["Leader off in push"]
    assert is_right(case, GOOD)
    for name in WRONG:
        assert not is_right(case, End(**{**vars(GOOD), name: False}))
    assert not is_right(case, replace(GOOD, ended="done"))


def test_hidden_leds_must_be_seen_to_pause_and_to_be_searched_for_only_when_long_gone() -> None:
    done = replace(GOOD, ended="done", cause="", held=False)
    ends = [
        replace(done, paused=paused, searches=searches) for paused, searches in (("LEDs", 0), ("", 0), ("LEDs", 1))
    ]
    assert [is_right(CASES["hidden 1 s"], end) for end in ends] == [True, False, False]
    assert [is_right(CASES["hidden 5 s"], end) for end in ends] == [False, False, True]


def test_what_is_stopped_for_a_moment_must_be_seen_to_rearm() -> None:
    case, done = CASES["controller stalls for 0.2 s"], replace(GOOD, ended="done", cause="")
    assert is_right(case, replace(done, rearmed=1))
    assert not is_right(case, done)


def test_a_switch_stuck_closed_must_be_named_and_must_keep_it_from_arming() -> None:
    named = "acquire_timeout: the Leader's lock has a fault: lock switch closed while the lock is open"
    good = replace(GOOD, ended="acquire_timeout", cause=named, armed=False)
    case = CASES["lock switch stuck closed"]
    assert is_right(case, good)
    assert not is_right(case, replace(good, armed=True))
    assert not is_right(case, replace(good, cause="acquire_timeout: no docking state"))


def test_leds_and_leader_are_lost_in_every_phase() -> None:
    driven = set(ACTIVE)
    for deed in ("led", "leader"):
        assert {case.phase for case in CASES.values() if case.deed == deed} == driven


@pytest.mark.parametrize(("end", "code"), [(GOOD, 0), (replace(GOOD, ended="unwell"), 1)])
def test_an_incident_that_ends_wrongly_is_named_and_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, end: End, code: int
) -> None:
    monkeypatch.setattr(incidents, "run_all", lambda _work, todo, *_: [end] * len(todo))
    arguments = ["incidents", "--trials", "2", "--cases", "Leader off in push", "--out", str(tmp_path)]
    result = CliRunner().invoke(experiment, arguments)
    assert result.exit_code == code
    assert ("2 missed:" if code else "None missed.") in result.output
    assert ("ended='unwell'" in result.output) == bool(code)


def test_only_a_report_that_tells_the_same_end_agrees() -> None:
    docking = Docking(1, "aborted", "leds_lost: 3 searches")
    record = {"docked": False, "cause": docking.cause, "code": "leds_lost", "needs_reset": False}
    assert report_agrees(record, docking)
    for changed in ({"docked": True}, {"cause": ""}, {"code": "slip"}, {"needs_reset": True}):
        assert not report_agrees(record | changed, docking)
    assert not report_agrees({}, docking)
