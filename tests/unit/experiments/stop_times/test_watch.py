"""The notes of the wheels' frames: gaps, and whether they were stops."""

from __future__ import annotations

import struct

from common.canopen.frames import RPDO, CanFrame
from common.timing import NS_PER_MS
from experiments.stop_times.watch import WheelNotes


def frame(speed: int, word: int = 0x0F) -> CanFrame:
    return CanFrame(RPDO[0] + 1, struct.pack("<Hi", word, speed))


def test_a_gap_after_which_the_wheels_move_on_was_no_stop() -> None:
    notes = WheelNotes((1, 2))
    for at_ms, each in ((0, 900), (10, -1000), (140, 800), (150, 0), (400, 800), (410, 700), (600, 0)):
        notes.note(frame(each), (1000 + at_ms) * NS_PER_MS)
    assert notes.gaps_without_stop == 1
    assert notes.longest_gap_ns == 250 * NS_PER_MS
    assert notes.fastest_counts == 1000
    notes.note(frame(700), 1610 * NS_PER_MS)
    notes.note(frame(700, word=0x02), 1800 * NS_PER_MS)
    assert notes.gaps_without_stop == 1
    notes.restart()
    assert (notes.gaps_without_stop, notes.longest_gap_ns, notes.fastest_counts) == (0, 0, 0)
