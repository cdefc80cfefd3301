"""Requests are carried out once, whatever is sent again, and an abort is never swallowed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from common.channels import DOCK_REQUEST, LOCK_REQUEST, Channel
from common.files.parsing import UnreadableError
from common.messages import Answer, DockRequest, Header, LockRequest, MessageError, decode, encode
from common.node import Received
from common.request_desk import KEPT_NS, MOST_KEPT, MOST_MARKS, RequestDesk
from common.timing import NS_PER_S

NOW_NS = 100 * NS_PER_S
HEADER = Header("station", 7, 1, NOW_NS, "boot")
RESET = DockRequest("reset-1", NOW_NS + 5 * NS_PER_S, "reset")
UNLOCK = LockRequest("unlock-1", 5000, "unlock", 0, True)


def pack(channel: Channel[Any], answer: Answer) -> bytes:
    return encode(answer, Header(channel.publisher, 1, 1, NOW_NS, "boot"))


class Office:
    """A desk, what it hands on, and what it answers."""

    def __init__(self, marks: str = "") -> None:
        self.desk = RequestDesk("boot", pack)
        if marks:
            self.desk.restore(marks)
        self.answers: list[Answer] = []
        self.carried_out: list[str] = []

    def send(
        self, message: Any, header: Header = HEADER, channel: Channel[Any] = DOCK_REQUEST, now_ns: int = NOW_NS
    ) -> Received[Any] | None:
        request = self.desk.admit(channel, encode(message, header), now_ns, self.reply)
        if request is not None:
            self.carried_out.append(request.message.id)
        return request

    def reply(self, payload: bytes) -> None:
        self.answers.append(decode(Answer, payload)[1])

    def settle(self, request_id: str) -> None:
        answer = Answer(request_id, "done", "")
        self.desk.settle(answer, pack(DOCK_REQUEST, answer))

    def ask(self, message: Any, header: Header = HEADER, **given: Any) -> str:
        """The reason, or the outcome, of what is answered at once."""
        self.answers.clear()
        self.send(message, header, **given)
        return "; ".join(answer.reason or answer.outcome for answer in self.answers)


def test_a_repeated_request_is_handed_on_once_and_answered_the_same() -> None:
    office = Office()
    assert office.send(RESET) is not None
    assert office.send(RESET, replace(HEADER, sequence=2)) is None
    office.settle("reset-1")
    assert [answer.outcome for answer in office.answers] == ["done"]
    assert office.ask(RESET, replace(HEADER, sequence=3)) == "done"
    assert office.carried_out == ["reset-1"]


def test_recorded_bytes_do_nothing_after_many_others_and_after_the_id_is_forgotten() -> None:
    office = Office()
    office.send(UNLOCK, channel=LOCK_REQUEST)
    office.settle("unlock-1")
    for n in range(100):
        office.send(replace(UNLOCK, id=f"other-{n}", action="confirm"), replace(HEADER, sequence=2 + n), LOCK_REQUEST)
        office.settle(f"other-{n}")
    assert office.ask(UNLOCK, channel=LOCK_REQUEST) == "done"
    late_ns = NOW_NS + 2 * KEPT_NS
    assert office.ask(UNLOCK, channel=LOCK_REQUEST, now_ns=late_ns) == "seen before: a request is carried out once"
    assert office.carried_out.count("unlock-1") == 1


def test_recorded_bytes_do_nothing_after_a_restart() -> None:
    office = Office()
    office.send(UNLOCK, channel=LOCK_REQUEST)
    office.send(RESET)
    again = Office(office.desk.content())
    assert again.ask(UNLOCK, channel=LOCK_REQUEST) == "seen before: a request is carried out once"
    assert again.ask(RESET) == "seen before: a request is carried out once"
    assert again.send(RESET, replace(HEADER, sequence=2)) is not None, "its sender asks again, with a new sequence"


@pytest.mark.parametrize(
    ("header", "message", "reason"),
    [
        (replace(HEADER, boot_id="another"), RESET, "stamped in another boot"),
        (replace(HEADER, stamp_ns=NOW_NS + 1), RESET, "stamped in the future"),
        (HEADER, replace(RESET, expires_ns=2**62), "valid for longer than 60 s"),
    ],
)
def test_what_is_refused_is_answered_and_not_kept(header: Header, message: DockRequest, reason: str) -> None:
    office = Office()
    assert reason in office.ask(message, header)
    abort = replace(RESET, action="abort")
    assert office.send(abort) is not None, "the same id, genuine"


def test_clocks_of_two_robots_are_not_compared() -> None:
    office = Office()
    header = replace(HEADER, boot_id="another", stamp_ns=2**62)
    assert office.send(UNLOCK, header, LOCK_REQUEST) is not None


def test_an_id_stands_for_one_request() -> None:
    office = Office()
    office.send(RESET)
    office.settle("reset-1")
    other = replace(RESET, action="abort")
    assert office.ask(other, replace(HEADER, sequence=2)) == "this id stands for another request"
    with pytest.raises(ValueError, match="at least 1 character"):
        replace(RESET, id="")


def test_bytes_that_are_no_request_are_answered_and_named() -> None:
    office = Office()
    with pytest.raises(MessageError, match="not MessagePack"):
        office.desk.admit(DOCK_REQUEST, b"\xc1", NOW_NS, office.reply)
    assert office.answers[-1].reason.startswith("not a request")


def test_unanswered_requests_are_forgotten_in_time_and_a_flood_keeps_no_abort_out() -> None:
    office = Office()
    for n in range(MOST_KEPT + 10):
        office.send(replace(RESET, id=f"r{n}"), replace(HEADER, sequence=n + 1))
    assert len(office.carried_out) == MOST_KEPT
    abort = replace(RESET, id="abort", action="abort")
    assert office.send(abort, replace(HEADER, run_id=8)) is not None
    late = replace(RESET, id="late", expires_ns=NOW_NS + KEPT_NS + NS_PER_S)
    assert office.send(late, replace(HEADER, run_id=8, sequence=2), now_ns=NOW_NS + KEPT_NS + 1) is not None
    assert len(office.desk._asked) == 1


def test_a_request_that_the_node_does_not_get_may_be_sent_again() -> None:
    office = Office()
    office.send(RESET)
    office.desk.withdraw("reset-1")
    assert office.send(RESET, replace(HEADER, sequence=2)) is not None


def test_marks_are_bounded() -> None:
    office = Office()
    for run in range(MOST_MARKS + 10):
        office.send(replace(RESET, id=f"r{run}"), replace(HEADER, run_id=run))
    assert len(office.desk._marks) == MOST_MARKS


NO_MARKS = '{"schema": "requests_seen/1", "seen": %s}'


@pytest.mark.parametrize("text", ["", "[]", "{}", NO_MARKS % "[[1]]", NO_MARKS % "1", "[" * 9999])
def test_a_spoilt_file_of_marks_is_named(text: str) -> None:
    with pytest.raises(UnreadableError):
        RequestDesk("boot", pack).restore(text)


def test_a_file_cut_at_any_byte_is_named_or_whole() -> None:
    office = Office()
    office.send(RESET)
    content = office.desk.content()
    for cut in range(len(content) - 1):
        with pytest.raises(UnreadableError):
            RequestDesk("boot", pack).restore(content[:cut])
