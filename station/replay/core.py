"""One node's recorded steps, through its own ``step`` again."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.channels import FRAME, Channel
from common.config import Config
from common.errors import ConfigError
from common.messages import Answer, MessageError, NodeSnapshot, decode
from common.node import Inbox, Node, NodeContext, Output, Received
from common.processes import process
from common.recording import snapshot
from common.recording.devices import PIXELS
from common.recording.recording import ProcessRun, Recording
from common.recording.steps import JournaledStep, Taken
from station.replay.recorded_devices import RecordedClock, RecordedWatch

CORES = {
    "estimator": "follower-estimator",
    "controller": "follower-controller",
    "supervisor": "follower-supervisor",
    "gate": "follower-can-bridge",
    "arms": "follower-arms",
    "leader": "leader",
}


@dataclass(frozen=True)
class Segment:
    """Steps in a row whose inputs the file holds all; ``state`` is the node's before the first, None at its start."""

    steps: list[JournaledStep]
    state: list[NodeSnapshot] | None


def segments(recording: Recording, run: ProcessRun) -> list[Segment]:
    """What of a run can be replayed exactly: from each recorded state to the next input or step that was lost."""
    found: list[Segment] = []
    steps: list[JournaledStep] | None = None
    before = -1
    for step in run.steps:
        whole = not missing_inputs(recording, step)
        if steps is not None and (step.number != before + 1 or not whole):
            steps = None
        if steps is None and whole and step.number in run.snapshots:
            steps = []
            found.append(Segment(steps, run.snapshots[step.number]))
        if steps is not None:
            steps.append(step)
        before = step.number
    return found


def missing_inputs(recording: Recording, step: JournaledStep) -> list[str]:
    """Keys of the inputs that the step had and the file does not hold; of a frame its pixels too."""
    missing = []
    looked = any(form == PIXELS and packed for _, form, packed in step.calls)
    for seen in step.states:
        payload = recording.payload(seen.key, seen.crc, seen.receipt_ns)
        if payload is None or (looked and seen.key == FRAME.key and not _has_pixels(recording, payload)):
            missing.append(seen.key)
    return missing


def _has_pixels(recording: Recording, payload: bytes) -> bool:
    """Whether the frame is recorded without loss; where none is, the replay says so when it needs one."""
    if not recording.frames.there:
        return True
    try:
        return decode(FRAME.message, payload)[1].capture_ns in recording.frames.times_ns
    except MessageError:
        return False


@dataclass(frozen=True)
class Step:
    """One replayed step beside the recorded one."""

    recorded: JournaledStep
    outputs: tuple[Output, ...]


class ReplayedNode:
    """A node that is fed from a recording.

    Args:
        recording: with the run's inputs.
        run: of the node's process.
        config: with which to make it: the recorded one, or another.
        config_path: beside which files that the configuration names are looked for.
        folder: private and temporary.
        segment: what to replay.
    """

    def __init__(
        self, recording: Recording, run: ProcessRun, config: Config, config_path: Path, folder: Path, segment: Segment
    ) -> None:
        self._recording, self.run, self._steps = recording, run, segment.steps
        self._clock = RecordedClock(run.boot_id)
        self._watch = RecordedWatch(recording.frames)
        config = config.model_copy(update={"state_directory": str(folder)})
        context = NodeContext(config, config_path, folder, run.run_id, self._clock, self._watch)
        self._node: Node = process(run.process).factory()(context)
        self._channels: dict[str, Channel[Any]] = {
            channel.key: channel for channel in (*self._node.inputs, *self._node.outputs, *self._node.serves)
        }
        self._inbox = Inbox(run.boot_id)
        self._late = dict.fromkeys((channel.key for channel in self._node.inputs), 0)
        if segment.state is not None:
            self._restore(segment.state)
        else:
            self._clock.begin(segment.steps[0])
            self._node.start(segment.steps[0].now_ns)

    def _restore(self, state: list[NodeSnapshot]) -> None:
        outside: dict[str, Any] = {**self._watch.devices, "clock": self._clock}
        try:
            snapshot.restore(state, self._node, self._inbox, outside)
        except snapshot.SnapshotError as error:
            raise ConfigError(f"{self._recording.path}: {self.run.process}: {error}") from error
        self._late.update(self._inbox.kept()[1])

    def replay(self) -> Iterator[Step]:
        """Step by step.

        Raises:
            DivergedError: the node asks for what the recorded one did not.
        """
        for step in self._steps:
            self._feed(step)
            self._clock.begin(step)
            self._watch.begin(step)
            self._inbox.begin_step()
            yield Step(step, tuple(self._node.step(step.now_ns, self._inbox)))

    def _feed(self, step: JournaledStep) -> None:
        for seen in step.states:
            payload = self._recording.payload(seen.key, seen.crc, seen.receipt_ns)
            if payload is not None and seen.key in self._channels:
                self._inbox.put_state(self._channels[seen.key], payload, seen.receipt_ns)
        self._late.update(step.late)
        self._inbox.put_back({}, self._late)
        for taken in step.taken:
            self._ask(taken)

    def _ask(self, taken: Taken) -> None:
        channel = self._channels.get(taken.key)
        if channel is None:
            return
        kind: Any = Answer if taken.is_answer else channel.message
        try:
            header, message = decode(kind, taken.payload)
        except MessageError as error:
            raise ConfigError(f"{self._recording.path}: {taken.key}: {error}") from error
        self._inbox.put_request(channel, Received(message, header, taken.receipt_ns))


@contextmanager
def replayed(
    recording: Recording, run: ProcessRun, config: Config, config_path: Path, segment: Segment
) -> Iterator[ReplayedNode]:
    """A replayed node with a temporary folder of its own.

    Args:
        recording: with the run's inputs.
        run: of the node's process.
        config: with which to make it.
        config_path: beside which files that the configuration names are looked for.
        segment: what to replay.
    """
    with tempfile.TemporaryDirectory(prefix="davpc-replay-") as folder:
        yield ReplayedNode(recording, run, config, config_path, Path(folder), segment)


def longest_run(recording: Recording, core: str) -> ProcessRun:
    """The run of a core's process with the most steps.

    Raises:
        ConfigError: it was not journaled.
    """
    runs = recording.runs(CORES[core])
    if not any(run.steps for run in runs):
        raise ConfigError(f"{recording.path}: no journal of {CORES[core]}: nothing to replay")
    return max(runs, key=lambda run: len(run.steps))
