"""What the experiments of the collection count as right, and what they run with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from common.causes import CAUSES
from common.config import Config
from experiments.queues import incidents
from experiments.queues.incident_cases import CASES
from experiments.queues.incidents import End, is_right, report_agrees
from experiments.queues.plots import draw_sequential
from experiments.queues.run import Docking, plan, planned_config
from experiments.queues.scenarios import SCENARIOS, Job, world_changes
from experiments.queues.sequential import bound_m, image_bound, metrics_of, missed, missed_means
from follower.supervisor.transitions import ACTIVE
from sim.optics.scenes import SCENES
from sim.world_config import world_config
from station.experiment import experiment


def docked(trolley: int, e_y_cm: float) -> Docking:
    metrics = {"e_x_cm": 0.5, "e_y_cm": e_y_cm, "e_theta_deg": 0.2, "e_p_px": 1.0}
    return Docking(trolley, "done", "", metrics=metrics, locked=True)


def test_a_later_trolley_starts_with_the_others_in_the_queue(config: Config) -> None:
    planned = planned_config(plan(config, first=5, start=[8.0, 0.5, 0.0], scene="glass_hall", seed=9))
    world = world_config(planned, "plan")
    assert (world.docked, world.scene, world.seed) == (4, "glass_hall", 9)
    assert planned.follower_can.bus.interface == planned.leader_can.bus.interface == "stepped"
    assert config.world["seed"] != 9


def test_only_what_is_truly_locked_within_its_bound_counts(config: Config) -> None:
    false = docked(1, 0.5)
    false.locked = False
    metrics = metrics_of(config, [docked(1, 0.5), docked(1, 6.5), false, Docking(1, "aborted", "leds_lost")])
    assert metrics["docked"] == 1
    assert metrics["worst_e_y_cm"] == 6.5
    assert metrics["e_y_cm"] == pytest.approx(2.5)
    assert metrics_of(config, [docked(2, 6.5)])["docked"] == 1
    assert bound_m(config, 1) < bound_m(config, 2)


def test_the_image_allows_less_with_each_trolley(config: Config) -> None:
    bounds = np.array([image_bound(config, trolley) for trolley in range(1, 9)])
    assert (np.diff(bounds, axis=0) > 0.0).all()
    assert bounds[0, 0] < 0.5


def test_scenarios_are_those_of_the_paper_and_vary_with_the_trial(config: Config) -> None:
    assert [(s.name, s.trolley) for s in SCENARIOS.values()] == [
        ("dark_outdoor", 1),
        ("parking_lot", 2),
        ("glass_hall", 5),
    ]
    text = config.model_dump_json()
    for scenario in SCENARIOS.values():
        assert scenario.scene in SCENES
        starts = {tuple(world_changes(Job(text, scenario, 1, trial))["start"]) for trial in range(20)}
        assert len(starts) == 20
        for start in starts:
            planned = plan(config, first=scenario.trolley, scene=scenario.scene, start=list(start))
            world_config(planned_config(planned), scenario.name)


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


def test_what_is_stopped_for_a_moment_must_be_seen_to_be_armed_anew() -> None:
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
def test_an_incident_that_ends_wrongly_is_told_and_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, end: End, code: int
) -> None:
    monkeypatch.setattr(incidents, "run_all", lambda _work, todo, *_: [end] * len(todo))
    arguments = ["incidents", "--trials", "2", "--cases", "Leader off in push", "--out", str(tmp_path)]
    result = CliRunner().invoke(experiment, arguments)
    assert result.exit_code == code
    assert ("2 missed:" if code else "None missed.") in result.output
    assert ("ended='unwell'" in result.output) == bool(code)


def test_a_queue_misses_what_is_not_locked_not_within_its_bound_or_never_begun(config: Config) -> None:
    seen_wrong = docked(3, 0.5)
    seen_wrong.false_locks = 1
    queues = [
        [docked(1, 6.5), docked(2, 6.5), seen_wrong, docked(4, 1.0)],
        [docked(1, 0.1), Docking(2, "aborted", "slip")],
    ]
    assert missed(config, queues, 4) == [
        "trial 0, trolley 1: e_y 6.5 cm, more than 6 cm",
        "trial 0, trolley 3: false lock on the way",
        "trial 1, trolley 2: slip",
        "trial 1, trolley 3: not begun",
        "trial 1, trolley 4: not begun",
    ]


def test_a_mean_beyond_its_limit_is_missed_the_first_trolleys_sooner() -> None:
    queues = [[docked(1, 0.5), docked(2, 1.4)], [docked(1, 0.7), docked(2, 1.5)]]
    assert missed_means(queues) == ["trolley 1: mean e_y_cm 0.60, more than 0.5"]
    queues[1][1] = docked(2, 1.8)
    queues[0][0] = docked(1, 0.1)
    assert missed_means(queues) == ["trolley 2: mean e_y_cm 1.60, more than 1.5"]
    assert missed_means([[Docking(1, "aborted", "slip")]])[0].startswith("trolley 1: mean e_y_cm nan")


def test_only_a_report_that_tells_the_same_end_agrees() -> None:
    docking = Docking(1, "aborted", "leds_lost: 3 searches")
    record = {"docked": False, "cause": docking.cause, "code": "leds_lost", "needs_reset": False}
    assert report_agrees(record, docking)
    for changed in ({"docked": True}, {"cause": ""}, {"code": "slip"}, {"needs_reset": True}):
        assert not report_agrees(record | changed, docking)
    assert not report_agrees({}, docking)


def test_the_figure_is_drawn_with_failures_in_it(config: Config, tmp_path: Path) -> None:
    queues = [[docked(1, 0.3), docked(2, 0.6)], [docked(1, 0.2), Docking(2, "aborted", "leds_lost")]]
    draw_sequential(queues, [image_bound(config, trolley) for trolley in (1, 2)], config, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
