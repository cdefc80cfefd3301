"""The tables of phases and causes are complete, and the pages show them as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from common import causes
from common.causes import CAUSES, cause_code, needs_reset
from common.messages import PHASES, Phase
from follower.supervisor import transitions
from follower.supervisor.transitions import ACTIVE, ENDED, FREE, IN_CONTACT, TABLE, next_phase

ROOT = Path(__file__).parents[2]


def test_the_pages_show_the_tables_as_they_are() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text()
    begin = page.index("| in | event |")
    assert page[begin : page.index("\n\n", begin)] == transitions.as_markdown()
    assert causes.as_markdown() in (ROOT / "docs/causes.md").read_text()


def test_each_phase_of_a_docking_is_free_in_contact_or_backs_away() -> None:
    assert sorted((*FREE, *IN_CONTACT, "retract")) == sorted(ACTIVE)
    assert sorted((*ACTIVE, *ENDED, "manual")) == sorted(PHASES)


def test_no_event_leads_two_ways_and_every_phase_can_be_left_and_reached() -> None:
    keys = [(row.phase, row.event) for row in TABLE]
    assert len(set(keys)) == len(keys)
    docking = set(PHASES) - {"manual"}
    assert {row.phase for row in TABLE} == docking
    assert {row.to for row in TABLE} == docking
    with pytest.raises(KeyError):
        next_phase("idle", "connected")


@pytest.mark.parametrize("phase", [phase for phase in PHASES if phase != "manual"])
def test_from_every_phase_an_operator_gets_back_to_idle(phase: Phase) -> None:
    before = next_phase(phase, "abort") if phase in ACTIVE else phase
    assert next_phase(before, "reset") == "idle"


def test_every_cause_that_is_named_is_explained() -> None:
    named: set[str] = set()
    for path in (ROOT / "follower/supervisor").rglob("*.py"):
        named |= set(re.findall(r'failed\(\s*f?"([a-z_]+)', path.read_text()))
        named |= set(re.findall(r'PhaseResult\("(?:failed|abort|unreachable)", f?"([a-z_]+)', path.read_text()))
        named |= set(re.findall(r'(?:self\.code, self\.reason|cause) = "([a-z_]+)"', path.read_text()))
    assert len(named) > 20
    assert named - {"lock_"} - set(CAUSES) == set()
    assert {f"lock_{outcome}" for outcome in ("refused", "expired")} <= set(CAUSES)


def test_unknown_causes_are_the_careful_ones() -> None:
    assert needs_reset("drive_fault: node 3")
    assert not needs_reset("operator_abort")
    assert needs_reset("never heard of")
    assert cause_code("gate_stop: second_writer") == "gate_stop"
