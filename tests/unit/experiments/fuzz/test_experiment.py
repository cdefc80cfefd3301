"""A small part of the fuzzing, the corpus of what it found, and that it notices what it looks for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest

from common.channels import CHANNELS, Channel
from common.config import Config
from common.messages import MessageError
from experiments.fuzz import experiment
from experiments.fuzz.experiment import FuzzPlan, run
from experiments.fuzz.file_kinds import PROCESS_KINDS
from experiments.fuzz.files import FileKind, run_file, run_truncations
from experiments.fuzz.messages import Receiver
from experiments.fuzz.watch import MOST_GROWTH_BYTES, BoundedCall
from experiments.shared.executor import ALONE
from station.fuzz_kinds import STATION_KINDS
from tests.rigs.canbus_rig import stepped_config

CORPUS = Path(__file__).parents[3] / "corpus"
KINDS = {kind.name.replace(" ", "_"): kind for kind in (*PROCESS_KINDS, *STATION_KINDS)}


@pytest.fixture(scope="module")
def config() -> Config:
    return stepped_config()


def test_a_small_run_finds_nothing_and_the_same_seed_sends_the_same(tmp_path: Path, config: Config) -> None:
    plan = FuzzPlan(messages=4_000, frames=1_500, files=60, stride=53)
    results = run(tmp_path, 1, ALONE, config, plan, STATION_KINDS)
    assert results["settings"]["missed"] == results["settings"]["not_reached"] == []
    assert json.loads((tmp_path / "results.json").read_text()) == results
    rows = {(row["method"], row["case"]): row for row in results["rows"]}
    assert rows["messages", "mutated"]["n"] == 4_000
    assert rows["attempts", "truncated"]["n"] > 100
    assert rows["CAN server", "mutated"]["n"] == 300
    assert all(row["metrics"]["taken"] > 0 for (_, case), row in rows.items() if case == "mutated")
    again = experiment.run(tmp_path, 1, ALONE, config, replace(plan, frames=0, files=0))
    assert again["rows"][0]["metrics"]["taken"] == rows["messages", "mutated"]["metrics"]["taken"]


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*/*")), ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_what_was_found_once_is_refused_by_name(path: Path, config: Config, tmp_path: Path) -> None:
    if path.parent.name == "messages":
        with pytest.raises(MessageError) as refused:
            Receiver(Random(1)).take(_channel(path), path.read_bytes())
        assert str(refused.value).isprintable()
        return
    kind = replace(KINDS[path.parent.name], example=lambda _config: path.read_bytes())
    watch = BoundedCall(kind.name, 1)
    copy = tmp_path / kind.file_name
    copy.write_bytes(path.read_bytes())
    watch.attempt(b"", lambda: kind.read(copy, config), kind.refuses)
    assert watch.tally.findings == {}
    assert watch.tally.refused == bool(kind.refuses)


def _channel(path: Path) -> Channel[Any]:
    """The channel whose schema the file's name begins with."""
    return next(each for each in CHANNELS if path.stem.startswith(each.message.SCHEMA.partition("/")[0]))


def test_a_reader_that_raises_or_accepts_too_much_is_a_finding(config: Config) -> None:
    def careless(path: Path, _config: Config) -> str:
        return "accepted too much" if json.loads(path.read_bytes())["n"] > 1 else ""

    kind = FileKind(name="x", file_name="x.json", form="json", example=lambda _config: b'{"n": 1}', read=careless)
    mutated, cut = run_file(kind, config, 1, 300, None), run_truncations(kind, config, 0, 100, None)
    assert "accepted too much" in mutated.findings
    assert any(name.startswith("KeyError in ") for name in mutated.findings)
    assert sum(found.count for found in cut.findings.values()) == 16
    assert mutated.growth_bytes < MOST_GROWTH_BYTES


def test_a_finding_is_kept_with_its_input(tmp_path: Path, config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    def raising(*_: object) -> str:
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr("experiments.fuzz.messages.Receiver.take", raising)
    results = run(tmp_path, 1, ALONE, config, FuzzPlan(messages=5, frames=0, files=0))
    (missed,) = results["settings"]["missed"]
    assert "ZeroDivisionError" in missed
    assert "5 times" in missed
    assert len(list((tmp_path / "findings").glob("messages-1-*.bin"))) == 1
    assert "by hand" in next((tmp_path / "findings").glob("*.txt")).read_text()


def test_what_the_time_did_not_reach_is_named(tmp_path: Path, config: Config) -> None:
    results = run(tmp_path, 1, ALONE, config, FuzzPlan(messages=2000, frames=0, files=0, seconds=1e-9))
    assert "messages, mutated" in results["settings"]["not_reached"]
    assert "Not reached in 1e-09 s: messages, mutated" in (tmp_path / "table.md").read_text()
