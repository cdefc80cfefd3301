"""The journal of a node's steps, written and read again."""

from __future__ import annotations

import threading

import pytest

from common.channels import COMMAND, DRIVES
from common.errors import DeviceError
from common.messages import Answer, Header, LockRequest, StepJournal
from common.node import Received
from common.recording.devices import ERROR, VALUE, unpacked_error
from common.recording.journal import JournalWriter
from common.recording.steps import JournalError, steps_of
from common.timing import Clock, SteppedClock


class Meter:
    """A device that reads the clock itself."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.fault = "none"

    def read(self, scale: int) -> tuple[int, float]:
        self.clock.now_ns()
        return scale, 0.1

    def close(self) -> None:
        """Nothing comes back."""

    def fail(self) -> int:
        raise DeviceError("left wheel: silent")


def test_a_step_comes_back_with_all_that_it_consumed() -> None:
    journal = JournalWriter()
    clock = journal.clock(SteppedClock(5))
    meter = journal.device("meter", Meter(clock))
    assert meter.read(1) == (1, 0.1), "between steps: belongs to the next one"
    step = journal.begin(100)
    journal.states({DRIVES.key: (b"abc", 90)}, {DRIVES.key: 2})
    assert clock.now_ns() == 5
    assert meter.read(2) == (2, 0.1)
    assert meter.fault == "none"
    meter.close()
    with pytest.raises(DeviceError):
        meter.fail()
    request = Received(LockRequest("a", 1000, "lock"), Header("s", 1, 2, 3, "b"), 95)
    journal.taken("leader/request/lock", [request])
    journal.end(step, 2)
    assert journal.batches() == [], "its outputs have not left yet"
    answer = Answer("a", "done", "")
    journal.sent(step, COMMAND, answer, b"whole", 101, 9)
    journal.sent(step, DRIVES, request.message, b"other", 102, 10)
    (batch,) = journal.batches()
    (read,) = steps_of(batch)
    assert (read.number, read.now_ns, read.reads_ns) == (0, 100, (5,))
    assert [(seen.key, seen.receipt_ns) for seen in read.states] == [(DRIVES.key, 90)]
    assert read.late == {DRIVES.key: 2}
    assert [(each.key, each.is_answer, each.receipt_ns) for each in read.taken] == [
        ("leader/request/lock", False, 95)
    ]
    assert [(name, form) for name, form, _ in read.calls] == [
        ("meter.read", VALUE),
        ("meter.read", VALUE),
        ("meter.fault", VALUE),
        ("meter.fail", ERROR),
    ]
    assert str(unpacked_error(read.calls[3][2])) == "left wheel: silent"
    assert [(sent.key, sent.sequence, sent.payload) for sent in read.outputs] == [
        (COMMAND.key, 0, b"whole"),
        (DRIVES.key, 10, None),
    ]


def test_what_other_threads_read_is_not_journaled() -> None:
    journal = JournalWriter()
    clock = journal.clock(SteppedClock(5))
    step = journal.begin(100)
    other = threading.Thread(target=clock.now_ns)
    other.start()
    other.join()
    journal.end(step, 0)
    (batch,) = journal.batches()
    assert [read.reads_ns for read in steps_of(batch)] == [()]


def test_batches_count_on_and_a_step_too_large_is_counted() -> None:
    journal = JournalWriter()
    for number in range(3):
        step = journal.begin(number)
        for _ in range(200 if number == 1 else 1):
            journal.called("big", str, "x" * 400)
        journal.end(step, 0)
    batches = journal.batches()
    assert [step.number for batch in batches for step in steps_of(batch)] == [0, 2]
    assert batches[-1].lost_steps == 1


@pytest.mark.parametrize("steps", [b"", b"\xc1", b"\x93\x01\x02\x03", b"\x97" + b"\x01" * 7])
def test_a_damaged_journal_is_one_line(steps: bytes) -> None:
    with pytest.raises(JournalError, match="damaged near step 4") as caught:
        list(steps_of(StepJournal(4, 1, (), steps, 0)))
    assert "\n" not in str(caught.value)
