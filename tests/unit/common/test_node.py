"""What executors promise a node: newest values, freshness by the source's stamp, requests once."""

from __future__ import annotations

from typing import Literal

import pytest

from common.channels import DOCK_REQUEST, DOCKING_STATE, LEADER_STATE, MISSION, Channel
from common.config import Config
from common.messages import DockRequest, Header, LeaderState, MessageError, decode, encode
from common.node import REQUEST_BACKLOG, Inbox, Outbox, Received
from common.timing import NS_PER_MS, NS_PER_S

LEADER = LeaderState(True, "", (1.0,), False, "down", "open", 0.0, 0)
LOCAL = Channel("robot/test", LeaderState, "leader", 10, 100)


@pytest.fixture
def inbox() -> Inbox:
    return Inbox("boot")


def leader(queue: int, stamp_ns: int = 0, boot: str = "boot") -> bytes:
    message = LeaderState(True, "", (1.0,), False, "down", "open", 0.0, queue)
    return encode(message, Header("leader", 1, queue + 1, stamp_ns, boot))


def test_only_the_newest_of_a_state_is_kept_and_it_arrives_in_one_step(inbox: Inbox) -> None:
    inbox.put_state(LOCAL, leader(1), 0)
    inbox.put_state(LOCAL, leader(2), 0)
    assert inbox.arrived(LOCAL) is None
    inbox.begin_step()
    message = inbox.arrived(LOCAL)
    assert message is not None
    assert message.queue == 2
    inbox.begin_step()
    assert inbox.arrived(LOCAL) is None
    newest = inbox.newest(LOCAL)
    assert newest is not None
    assert newest.message.queue == 2


def test_age_counts_from_the_sources_stamp_within_a_robot(inbox: Inbox) -> None:
    inbox.put_state(LOCAL, leader(1, stamp_ns=0), receipt_ns=90 * NS_PER_MS)
    inbox.begin_step()
    assert inbox.fresh(LOCAL, 100 * NS_PER_MS) is not None
    assert inbox.fresh(LOCAL, 100 * NS_PER_MS + 1) is None


def test_age_counts_from_receipt_between_robots_whose_clocks_differ(inbox: Inbox) -> None:
    inbox.put_state(LEADER_STATE, leader(1, stamp_ns=10**15, boot="another machine"), receipt_ns=0)
    inbox.begin_step()
    assert inbox.fresh(LEADER_STATE, 500 * NS_PER_MS) is not None
    assert inbox.fresh(LEADER_STATE, 501 * NS_PER_MS) is None


def test_a_message_of_another_boot_is_refused_within_a_robot(inbox: Inbox) -> None:
    inbox.put_state(LOCAL, leader(1, boot="before the reboot"), 0)
    inbox.begin_step()
    assert inbox.newest(LOCAL) is None
    assert inbox.malformed == 1


def test_a_malformed_message_is_counted_and_the_last_good_one_stays(inbox: Inbox) -> None:
    inbox.put_state(LOCAL, leader(3), 0)
    inbox.begin_step()
    assert inbox.newest(LOCAL) is not None
    inbox.put_state(LOCAL, b"garbage", 0)
    inbox.begin_step()
    assert inbox.arrived(LOCAL) is None
    newest = inbox.newest(LOCAL)
    assert newest is not None
    assert newest.message.queue == 3
    assert inbox.malformed == 1
    assert "MessagePack" in inbox.faults[0]


def test_what_comes_during_a_step_belongs_to_the_next(inbox: Inbox) -> None:
    inbox.put_state(LOCAL, leader(1), 0)
    inbox.begin_step()
    inbox.put_state(LOCAL, leader(2), 0)
    seen = []
    for _ in range(3):
        message = inbox.arrived(LOCAL)
        seen.append(message.queue if message else None)
        inbox.begin_step()
    assert seen == [1, 2, None]


def test_requests_are_all_kept_in_order_and_bounded_but_an_abort_finds_a_place(inbox: Inbox) -> None:
    def put(request_id: str, action: Literal["start", "abort"]) -> bool:
        request = Received(DockRequest(request_id, 10, action), Header("cli", 1, 1, 0, "boot"), 0)
        return inbox.put_request(DOCK_REQUEST, request)

    assert [put(str(n), "start") for n in range(REQUEST_BACKLOG + 1)] == [True] * REQUEST_BACKLOG + [False]
    assert put("abort", "abort")
    ids = [received.message.id for received in inbox.requests(DOCK_REQUEST)]
    assert ids == [*(str(n) for n in range(REQUEST_BACKLOG)), "abort"]
    assert inbox.requests(DOCK_REQUEST) == []


@pytest.mark.parametrize(("ahead_ms", "fresh"), [(0, True), (19, True), (21, False), (10_000, False)])
def test_a_message_from_the_future_is_not_fresh(inbox: Inbox, ahead_ms: int, fresh: bool) -> None:
    stamp_ns = NS_PER_S + ahead_ms * NS_PER_MS
    inbox.put_state(LOCAL, encode(LEADER, Header("leader", 1, 1, stamp_ns, "boot")), NS_PER_S)
    inbox.begin_step()
    assert (inbox.fresh(LOCAL, NS_PER_S) is not None) == fresh


def test_what_is_logged_of_bad_bytes_is_one_short_printable_line(inbox: Inbox) -> None:
    inbox.refuse(MessageError("schema 'x\n2026-01-01 follower-supervisor INFO all is well" + "x" * 10_000))
    (line,) = inbox.faults
    assert line.isprintable()
    assert len(line) <= 200


def test_headers_number_each_channel_by_itself() -> None:
    outbox = Outbox("leader", 5, "boot")
    first, _ = decode(LeaderState, outbox.pack(LEADER_STATE, LEADER, 1))
    second, _ = decode(LeaderState, outbox.pack(LEADER_STATE, LEADER, 2))
    other, _ = decode(LeaderState, outbox.pack(LOCAL, LEADER, 3))
    assert (first.sequence, second.sequence, other.sequence) == (1, 2, 1)
    assert (second.source, second.run_id, second.stamp_ns) == ("leader", 5, 2)


def test_ages_of_the_channel_table_are_those_of_the_safety_specification(config: Config) -> None:
    assert (MISSION.max_age_ms, DOCKING_STATE.max_age_ms, LEADER_STATE.max_age_ms) == (200, 100, 500)
    assert config.follower_can.watchdog_ms <= 80


def test_malformed_states_are_counted_until_one_can_be_read(inbox: Inbox) -> None:
    counts = []
    for payload in (b"", b"\xff", leader(1), b"\xff"):
        inbox.put_state(LOCAL, payload, 0)
        inbox.begin_step()
        inbox.newest(LOCAL)
        inbox.newest(LOCAL)
        counts.append(inbox.malformed_in_a_row(LOCAL))
    assert counts == [1, 2, 0, 1]
