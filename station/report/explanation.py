"""Why a docking ended, in words: the cause, what to do, and what the recording shows before it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from common.causes import CAUSES, cause_code
from common.channels import (
    ARM_STATE,
    COMMAND,
    DOCKING_STATE,
    DRIVES,
    FRAME,
    LEADER_STATE,
    MISSION,
    Channel,
)
from common.timing import NS_PER_MS, NS_PER_S
from station.report.attempt import RecordedAttempt

# what happened shortly before the end is evidence
_BEFORE_NS = 5 * NS_PER_S
_WATCHED: tuple[Channel[Any], ...] = (FRAME, DOCKING_STATE, COMMAND, DRIVES, ARM_STATE, LEADER_STATE, MISSION)
_DARK = 0.5  # of the commanded current


def headline(attempt: RecordedAttempt) -> list[str]:
    """How it ended; for a failed one what the cause means and what to do."""
    if attempt.docked:
        return [f"Docked trolley {attempt.trolley} in {attempt.seconds(attempt.end_ns):.1f} s."]
    if not attempt.complete:
        return ["The recording ends before the docking does."]
    cause = CAUSES.get(cause_code(attempt.cause))
    lines = [f"Ended in {attempt.phases[-1][0]} after {attempt.seconds(attempt.end_ns):.1f} s: {attempt.cause}."]
    if cause is not None:
        lines += [f"Means: {cause.meaning}.", f"Do: {cause.remedy}."]
    if attempt.final.needs_reset:
        lines.append("It needs a reset.")
    return lines


def evidence(attempt: RecordedAttempt) -> list[str]:
    """What the recording shows in the seconds before the end, the most telling first; nothing where it docked."""
    if attempt.docked:
        return []
    return [*_restarts(attempt), *_silences(attempt), *_drives(attempt), *_leds(attempt), *_images(attempt)]


def _restarts(attempt: RecordedAttempt) -> Iterator[str]:
    """Processes that published under another run id, or not at all any more."""
    for channel in _WATCHED:
        runs: list[tuple[int, int]] = []
        for log_ns, header, _ in attempt.recording.messages(channel):
            if header.source == channel.publisher and (not runs or runs[-1][1] != header.run_id):
                runs.append((log_ns, header.run_id))
        for log_ns, _ in runs[1:]:
            if attempt.begin_ns <= log_ns <= attempt.end_ns + NS_PER_S:
                yield f"{channel.publisher} restarted at {attempt.seconds(log_ns):.1f} s"


def _silences(attempt: RecordedAttempt) -> Iterator[str]:
    """Channels that fell silent for longer than they may, the first one first."""
    found = []
    for channel in _WATCHED:
        gap = _gap(attempt, channel)
        if gap is not None:
            found.append((gap[0], channel, gap[1]))
    for begin_ns, channel, length_ns in sorted(found, key=lambda item: item[0]):
        who, length_s = f"{channel.publisher} ({channel.key})", length_ns / NS_PER_S
        yield f"nothing from {who} for {length_s:.1f} s from {attempt.seconds(begin_ns):.1f} s on"


def _gap(attempt: RecordedAttempt, channel: Channel[Any]) -> tuple[int, int] | None:
    """The first gap before the end that is longer than the channel's age allows: when, and how long."""
    least_ns = 2 * channel.max_age_ns
    since_ns = max(attempt.begin_ns, attempt.end_ns - _BEFORE_NS - least_ns)
    times = [record.log_ns for record in attempt.recording.topics.get(channel.key, ())]
    before = [time_ns for time_ns in times if time_ns < since_ns][-1:] or [since_ns]
    times = [*before, *(time_ns for time_ns in times if since_ns <= time_ns <= attempt.end_ns)]
    for before_ns, after_ns in zip(times, [*times[1:], attempt.end_ns], strict=True):
        if after_ns - before_ns > least_ns:
            return before_ns, after_ns - before_ns
    return None


def _drives(attempt: RecordedAttempt) -> Iterator[str]:
    """Faults of the drives, stop inputs, rules of the gate."""
    last = [item for item in attempt.within(attempt.drives) if item[0] >= attempt.end_ns - _BEFORE_NS]
    causes = Counter(f"{drives.state}: {drives.cause}" for _, drives in last if drives.cause)
    yield from (f"the drives report {text}" for text, _ in causes.most_common(2))
    if any(not drives.stop_inputs_clear for _, drives in last):
        when = next(log_ns for log_ns, drives in last if not drives.stop_inputs_clear)
        yield f"emergency stop, protective stop or their input: not clear from {attempt.seconds(when):.1f} s on"
    if last:
        more = last[-1][1].gate_interventions - last[0][1].gate_interventions
        rules = last[-1][1].gate_intervened
        if more:
            yield f"the gate intervened {more} times, the last time by {rules or 'a rule without a name'}"


def _leds(attempt: RecordedAttempt) -> Iterator[str]:
    """LEDs that draw too little, and what the Leader reports."""
    if not attempt.leader:
        return
    near = [state for time_ns, state in attempt.leader if time_ns <= attempt.end_ns]
    if not near:
        return
    leader = near[-1]
    for number, drawn in enumerate(leader.led_current_a):
        wanted = leader.led_setpoint_a[number] if number < len(leader.led_setpoint_a) else 0.0
        if wanted > 0 and drawn < _DARK * wanted:
            yield f"LED {number} draws {drawn:.2f} A of {wanted:.2f} A commanded"
        elif wanted == 0 and leader.led_setpoint_a:
            yield f"LED {number} is commanded off"
    if leader.cause:
        yield f"the Leader reports: {leader.cause}"
    if leader.lock == "fault":
        yield "the Leader's lock is in fault"


def _images(attempt: RecordedAttempt) -> Iterator[str]:
    """What was wrong with the frames, and how late they came."""
    last = [state for time_ns, state in attempt.within(attempt.states) if time_ns >= attempt.end_ns - _BEFORE_NS]
    wrong = Counter(state.cause for state in last if state.cause != "ok")
    for cause, count in wrong.most_common(2):
        if count > len(last) // 10:
            yield f"{count} of the last {len(last)} frames: {cause}"
    ages = sorted(
        (time_ns - state.capture_ns) / NS_PER_MS
        for time_ns, state in attempt.within(attempt.states)
        if time_ns >= attempt.end_ns - _BEFORE_NS
    )
    if ages and ages[len(ages) // 2] > DOCKING_STATE.max_age_ms / 2:
        yield f"frames were {ages[len(ages) // 2]:.0f} ms old when their state came"
