"""Every attempt leaves one record, and what the records say together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.channels import ARM_STATE, COMMAND
from common.config import Config
from common.errors import ConfigError
from common.geometry import Pose2
from common.messages import Answer, ArmState, Command, seal_command
from common.node import Inbox, Outbox
from follower.supervisor.attempt_report import AttemptReport
from follower.supervisor.journal import ATTEMPTS_FILE, Journal
from follower.supervisor.run_watch import RunWatch
from station.operate import attempts
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state


class Reporting(Bench):
    """A bench that keeps the records."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.report = AttemptReport(self.config)
        self.records: list[dict[str, Any]] = []

    def step(self, **changes: Any) -> Any:
        seen = replace(self.seen, now_ns=self.seen.now_ns, **changes)
        decided = super().step(**changes)
        record = self.report.step(replace(seen, now_ns=self.seen.now_ns), decided.mission, self.sequence.attempt)
        if record is not None:
            self.records.append(record)
        return decided


@pytest.fixture
def bench(config: Config) -> Reporting:
    return Reporting(config)


def to_done(bench: Reporting) -> None:
    bench.to_lock()
    bench.step(leader=replace(LEADER, lock="locked"))
    bench.step(lock_answers=(Answer(bench.lock_requests[0].id, "done", "locked"),))
    bench.run(0.1, arms=ArmState(0.0, False, False, False, True))
    bench.step()
    bench.run(0.1, drives=bench.roll(0.14 - 0.41))
    assert bench.sequence.phase == "done"


def test_a_docking_leaves_one_record(bench: Reporting) -> None:
    to_done(bench)
    bench.run(1.0)
    (record,) = bench.records
    assert json.loads(json.dumps(record)) == record
    assert (record["docked"], record["cause"], record["trolley"]) == (True, "", 1)
    assert set(record["phases_s"]) == {"acquire", "approach", "insert", "push", "lock", "release", "retract"}
    assert sum(record["phases_s"].values()) == pytest.approx(record["duration_s"], abs=0.01)
    assert record["arrival"] == {"e_x_cm": 0.0, "e_y_cm": 0.0, "e_theta_deg": 0.0}
    assert record["connected"]["e_x_cm"] == pytest.approx(0.0, abs=0.01)


def test_an_aborted_one_names_its_cause_and_what_it_met(bench: Reporting, config: Config) -> None:
    bench.to_approach()
    assert bench.seen.drives is not None
    assert bench.seen.state is not None
    valid = replace(bench.seen.state, features=((0.5, 0.1), (0.0, 0.0), (0.0, 0.1), (0.1, 0.0)))
    bench.run(0.2, state=valid)
    for _ in range(2):
        bench.step(state=docking_state(config, Pose2(5, 0, 0), valid=False))
        bench.run(0.8, state=valid)
    bench.step(drives=replace(bench.seen.drives, v_set_m_s=0.02, gate_intervened="token_age", gate_interventions=3))
    bench.ask("abort")
    (record,) = bench.records
    assert (record["docked"], record["code"], record["needs_reset"]) == (False, "operator_abort", False)
    assert record["pauses"] == {"LEDs not acquired (few_leds)": 2}
    assert record["gate"] == {"interventions": 3, "rules": {"token_age": 3}}
    lens = config.camera.lens
    edge = config.camera.width_px - 1 - (lens.cx_px + 0.5 * lens.fx_px)
    assert record["margins"]["field_of_view_px"] == pytest.approx(edge, abs=0.01)
    assert record["margins"]["dv_m_s"] == pytest.approx(0.025 - 0.02)


def test_records_reach_the_disk_and_a_full_one_only_keeps_the_next_docking(tmp_path: Path) -> None:
    good = Journal(tmp_path / "state")
    good.keep({"schema": "attempt/1"})
    good.keep(None)
    assert good.unfit(0) == ""
    good.close()
    assert (tmp_path / "state" / ATTEMPTS_FILE).read_text() == '{"schema": "attempt/1"}\n'
    blocked = tmp_path / "file"
    blocked.write_text("")
    bad = Journal(blocked)
    bad.unfit(0)
    bad.close()
    assert "reports cannot be written" in bad.unfit(0)


def test_an_unfit_disk_refuses_a_start_and_stops_nothing(bench: Reporting) -> None:
    bench.seen = replace(bench.seen, unfit="reports cannot be written: full")
    assert bench.ask("start").reason == "reports cannot be written: full"
    bench.seen = replace(bench.seen, unfit="")
    bench.to_approach()
    bench.run(1.0, unfit="reports cannot be written: full")
    assert bench.sequence.phase == "approach"


def test_a_process_that_restarts_ends_the_docking(bench: Reporting) -> None:
    bench.to_approach()
    bench.step(restarted="follower-estimator")
    assert bench.mission is not None
    assert (bench.mission.phase, bench.mission.cause, bench.mission.armed) == (
        "aborted",
        "restarted: follower-estimator",
        False,
    )


def test_runs_are_distinguished_by_their_headers() -> None:
    inbox, watch = Inbox("boot"), RunWatch()

    def put(run: int, source: str = "follower-arms") -> str:
        inbox.put_state(ARM_STATE, Outbox(source, run, "boot").pack(ARM_STATE, ARMS, 5), 5)
        inbox.begin_step()
        return watch.restarted(inbox)

    assert put(1) == ""
    assert put(1) == ""
    assert put(2) == "follower-arms"
    assert put(2) == ""
    command = seal_command(Command(0.0, 0.0, 1, 1, 1, 1, 1, 1))
    for run, source in ((7, "follower-controller"), (9, "operator"), (7, "follower-controller")):
        inbox.put_state(COMMAND, Outbox(source, run, "boot").pack(COMMAND, command, 5), 5)
        inbox.begin_step()
        assert watch.restarted(inbox) == ""


# --- all of them together


def table(number: int, **changes: Any) -> dict[str, Any]:
    noise = 0.1 * ((number * 7) % 5 - 2)
    base = {
        "schema": "attempt/1", "trolley": 1, "docked": True, "code": "", "duration_s": 30.0,
        "arrival": {"e_x_cm": noise, "e_y_cm": noise, "e_theta_deg": noise / 3},
        "connected": {"e_x_cm": noise, "e_y_cm": noise, "e_theta_deg": noise / 3},
        "margins": {"age_ms": 60.0 + number}, "gate": {"interventions": 1, "rules": {}},
        "retries": 0, "pauses": {"LEDs": 1},
    }  # fmt: skip
    return {**base, **changes}


def record(number: int, **changes: Any) -> attempts.Record:
    return attempts.Record.model_validate(table(number, **changes))


def test_the_summary_counts_and_takes_the_least_margins() -> None:
    records = [record(n) for n in range(6)] + [
        record(6, docked=False, code="leds_lost", arrival=None, connected=None)
    ]
    summary = attempts.summarise(records, 2)
    assert (summary.attempts, summary.docked, summary.unreadable) == (7, 6, 2)
    assert summary.causes == {"leds_lost": 1}
    assert summary.least_margins == {"age_ms": 60.0}
    assert (summary.pauses, summary.interventions) == (7, 7)
    assert summary.warnings == ()


def test_only_a_repeated_signed_bias_of_the_docked_pose_warns() -> None:
    def shifted(number: int, by_cm: float) -> attempts.Record:
        made = table(number)
        made["connected"]["e_y_cm"] += by_cm
        return attempts.Record.model_validate(made)

    assert attempts.biases([shifted(n, 1.5) for n in range(8)])[0].startswith("e_y_cm: +1.5")
    assert attempts.biases([shifted(n, 1.5 if n % 2 else -1.5) for n in range(8)]) == ()
    assert attempts.biases([shifted(n, 1.5) for n in range(3)]) == ()


def test_lines_that_make_no_sense_are_counted(tmp_path: Path) -> None:
    path = tmp_path / attempts.ATTEMPTS_FILE
    path.write_text(
        "\n".join(
            [
                json.dumps(table(1, cause="a line\u2028in two"), ensure_ascii=False),
                "{",
                "[]",
                '{"schema": "attempt/1"}',
                '{"schema": "attempt/9"}',
                "[" * 50_000,
                json.dumps(table(3, retries="2")),
                json.dumps(table(3, margins=[])),
                json.dumps(table(3, duration_s=10**400)),
                "",
                json.dumps(table(2)),
            ]
        )
    )
    records, unreadable = attempts.read_attempts(path, 10)
    assert (len(records), unreadable) == (2, 8)
    with pytest.raises(ConfigError, match="no reports"):
        attempts.read_attempts(tmp_path / "absent", 10)
