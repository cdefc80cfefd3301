"""One shift of a soak: collections in stepped time, in one process, with a fault in most dockings."""

from __future__ import annotations

import gc
from contextlib import closing
from dataclasses import dataclass, field
from random import Random

from common.channels import DOCK_REQUEST
from common.config import Config
from common.messages import DockRequest
from common.timing import NS_PER_S
from experiments.campaign.faults import FAULTS
from experiments.campaign.rows import Row
from experiments.campaign.stage import Stage, start_of
from experiments.campaign.trace import Trace
from experiments.campaign.unsafe import unsafe_motion
from experiments.queues.run import plan
from experiments.soak.resources import resident_mb

TROLLEYS = 4
TRIES = 3
FAULT_SHARE = 0.75
# all of them end by themselves; those of the campaign that last would have to be repaired
RECOVERABLE = (
    "controller_hung", "estimator_hung", "supervisor_hung", "arms_hung", "bridge_hung", "camera_hung", "late_loops",
    "restart_camera", "restart_estimator", "restart_controller", "restart_supervisor", "restart_bridge",
    "restart_arms", "leds_hidden", "wheel_silent", "joint_silent", "can_truncated", "can_replayed", "bus_off_briefly",
    "commands_doubled", "states_doubled", "abort",
)  # fmt: skip
PHASES = ("staging", "acquire", "approach", "insert", "push", "lock", "release", "retract")
UNNAMED = "not ended by name"
_ENDED = ("idle", "done", "aborted")
_BEGIN_S, _LIMIT_S, _AFTER_S = 3.0, 180.0, 0.5
_LATEST_S = 2.0
_ROW = Row(id="soak", what="any recoverable fault")


@dataclass(frozen=True, kw_only=True)
class Shift:
    """One job: which seed, and for how long, in simulated seconds."""

    config_text: str
    seed: int
    seconds: float


@dataclass(kw_only=True)
class Docked:
    """What became of one trolley.

    Attributes:
        seed: of its collection.
        trolley: its place in the queue.
        fault: what happened in its first try; empty if nothing.
        phase: in which it happened.
        ends: of each try: "done", the cause, or :data:`UNNAMED`.
        unsafe: what of the motion was not safe.
        counted: the Leader counts it in its queue, so the operator goes on with the next one, whatever the end was.
    """

    seed: int
    trolley: int
    fault: str
    phase: str
    ends: list[str] = field(default_factory=list)
    unsafe: list[str] = field(default_factory=list)
    counted: bool = False

    @property
    def docked(self) -> bool:
        """Whether it stands locked in the queue."""
        return self.ends[-1] == "done" or self.counted

    @property
    def wrong(self) -> list[str]:
        """What must not be, a line each."""
        faults = [*self.unsafe, *(end for end in self.ends if end == UNNAMED)]
        return [f"seed {self.seed}, trolley {self.trolley}, {self.fault or 'no fault'} {self.phase}: {what}"
                for what in faults]  # fmt: skip


@dataclass(kw_only=True)
class Worked:
    """A shift: its trolleys, simulated seconds, and after each collection (simulated s, resident MB)."""

    trolleys: list[Docked] = field(default_factory=list)
    seconds: float = 0.0
    memory: list[tuple[float, float]] = field(default_factory=list)


def work(shift: Shift) -> Worked:
    """Collections until the time is over; what is under way then is brought to its end."""
    config = Config.model_validate_json(shift.config_text)
    worked = Worked()
    number = 0
    while worked.seconds < shift.seconds:
        seed = Random(f"{shift.seed} {number}").randrange(2**31)
        start, world_seed = start_of(seed)
        with closing(Stage(plan(config, count=TROLLEYS, start=start, seed=world_seed), seed)) as stage:
            stage.station.collecting = False
            begin_ns = stage.clock.now_ns()
            _collect(stage, seed, worked, shift.seconds)
            worked.seconds += (stage.clock.now_ns() - begin_ns) / NS_PER_S
        del stage
        gc.collect()
        worked.memory.append((worked.seconds, resident_mb()))
        number += 1
    return worked


def _collect(stage: Stage, seed: int, worked: Worked, most_s: float) -> None:
    """One collection, until a trolley is given up."""
    draws = Random(f"{seed} faults")
    begin_ns = stage.clock.now_ns() - round(worked.seconds * NS_PER_S)
    stage.run(1.0)
    for trolley in range(1, TROLLEYS + 1):
        fault = draws.choice(RECOVERABLE) if draws.random() < FAULT_SHARE else ""
        phase, delay_s = draws.choice(PHASES), draws.uniform(0.0, _LATEST_S)
        entry = Docked(seed=seed, trolley=trolley, fault=fault, phase=phase if fault else "")
        worked.trolleys.append(entry)
        for attempt in range(TRIES):
            _try(stage, entry, fault if not attempt else "", delay_s, attempt)
            if entry.docked or entry.unsafe:
                break
        over = stage.clock.now_ns() - begin_ns >= most_s * NS_PER_S
        if over or not entry.docked:
            return


def _try(stage: Stage, entry: Docked, fault: str, delay_s: float, attempt: int) -> None:
    """Ask for one docking and follow it to its end."""
    name = f"soak-{entry.trolley}-{attempt}"
    if stage.station.phase == "aborted":
        stage.publish(DOCK_REQUEST, DockRequest(f"{name}-reset", stage.clock.now_ns() + 5 * NS_PER_S, "reset"))
        stage.run(1.0)
    trace = stage.begin_trace()
    expiry_ns = stage.clock.now_ns() + 5 * NS_PER_S
    stage.publish(DOCK_REQUEST, DockRequest(name, expiry_ns, "start", entry.trolley))
    begun = stage.run(_BEGIN_S, lambda: stage.station.phase not in _ENDED)
    if begun and fault:
        stage.run(_LIMIT_S, lambda: stage.station.phase in (entry.phase, *_ENDED))
        if stage.station.phase == entry.phase:
            stage.run(delay_s)
            FAULTS[fault](stage)
        else:
            entry.fault = entry.phase = ""  # passed over, as staging is with a trolley in the grippers
    if begun:
        stage.run(_LIMIT_S, lambda: stage.station.phase in _ENDED)
    stage.run(_AFTER_S)
    entry.ends.append(_end(stage, trace, begun))
    entry.counted = (stage.node("leader")._kept or 0) >= entry.trolley
    found = unsafe_motion(_ROW, "approach", trace, [], stage.config)
    entry.unsafe += [f"{what}, try {attempt + 1}" for what in found]
    stage.trace = None


def _end(stage: Stage, trace: Trace, begun: bool) -> str:
    """How a try ended, by name."""
    if not begun:
        return f"refused: {trace.refused}" if trace.refused else UNNAMED
    trace.close()
    if trace.end or stage.station.phase != "idle":
        return trace.end or UNNAMED
    # a supervisor that was restarted is idle: it disarmed, and forgot the docking
    return "restarted: follower-supervisor"
