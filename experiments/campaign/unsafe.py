"""What of a run's motion was not safe: by the world's truth and the bus. Pure: a trace in, names out."""

from __future__ import annotations

from bisect import bisect_right

from common.config import Config
from common.timing import NS_PER_MS, NS_PER_S
from experiments.campaign.rows import Row
from experiments.campaign.trace import BusSample, Trace, WorldSample

BRAKING_M_S2 = 0.5
_LAG_S = 0.5  # of wheels behind their drives, and of the robot behind its wheels
_SETTLED_M_S = 0.02
_STALE_NS = 135 * NS_PER_MS  # 120 ms, and one exchange of the bus
_EXCHANGES_NS = 25 * NS_PER_MS
_FIRST_NS = 150 * NS_PER_MS
_BLIND_NS = 450 * NS_PER_MS
_PUSH_BACK_NS = 200 * NS_PER_MS
_PUSH_BACK_N = 20.0
# of our own, not the gate's: most that the world may show in a phase, m/s
_CAPS_M_S = {
    "idle": 0.0,
    "staging": 0.10,
    "acquire": 0.10,
    "search": 0.0,
    "approach": 0.50,
    "insert": 0.05,
    "push": 0.05,
    "lock": 0.05,
    "release": 0.0,
    "retract": 0.10,
    "done": 0.0,
    "aborted": 0.0,
}
_CAP_SPARE_M_S = 0.03
# with a LED missing, once that was noticed and it has slowed down
_REDUCED_M_S, _REDUCED_NS = 0.13, 1_600 * NS_PER_MS
_LAST_METRE_M, _LAST_METRE_M_S = 0.9, 0.10
_OVERRUN_M = 0.10


def unsafe_motion(row: Row, phase: str, trace: Trace, reference: list[BusSample], config: Config) -> list[str]:
    """What of the motion was not safe, by name; empty if nothing.

    Args:
        row: what the fault itself explains is no fault of the robots.
        phase: of the docking, when the fault began.
        trace: what happened.
        reference: what the bus carried in the same time without the fault.
        config: the robots.
    """
    found = []
    if trace.error:
        found.append(f"a process ended: {trace.error}")
    if _moves_while_stopped(trace):
        found.append("speed while stopped")
    if _commanded_while_disarmed(trace):
        found.append("commanded while disarmed")
    if _beyond_cap(trace, config):
        found.append("beyond the cap")
    if row.reduced and any(s.v_m_s > _REDUCED_M_S and s.t_ns - trace.fault_ns > _REDUCED_NS for s in trace.world):
        found.append("not slowed down")
    if _stale(trace):
        found.append("stale command")
    if not row.lets_go and _released(trace):
        found.append("released in contact")
    if _unlocked(trace):
        found.append("unlocked")
    if trace.blind_ns is not None and phase not in ("retract", "staging", "release") and _blind(trace):
        found.append("moved without a living image")
    if row.pushes_not and _pushes_back(trace):
        found.append("pushed back")
    if trace.false_locks > 1 and not row.false_locks:
        found.append("false lock")
    if trace.disturbance > 1.001:
        found.append("disturbance beyond its bound")
    if row.stays and any(s.commanded for s in trace.bus if s.t_ns - trace.fault_ns > NS_PER_S):
        found.append("resumed")
    if row.identical and phase != "idle" and not _same(trace, reference):
        found.append("commands changed")
    if _overrun(phase, trace, config):
        found.append("backed too far")
    return found


def _commanded_while_disarmed(trace: Trace) -> bool:
    """Wheels commanded for more than two exchanges while not all drives are in operation.

    Not in the first moments: drives come into operation, and leave it, one after the other.
    """
    since_ns: int | None = None
    for sample in trace.bus:
        if not sample.commanded or (sample.arms_on and sample.wheels_on):
            since_ns = None
        elif since_ns is None:
            since_ns = sample.t_ns
        elif sample.t_ns - since_ns > _EXCHANGES_NS and sample.t_ns - trace.fault_ns > _FIRST_NS:
            return True
    return False


def _moves_while_stopped(trace: Trace) -> bool:
    """Speed after the set-points have been zero for longer than braking takes."""
    stopped_ns: int | None = None
    speed = 0.0
    commands = iter(trace.bus)
    newest = next(commands)
    upcoming = next(commands, None)
    for sample in trace.world:
        while upcoming is not None and upcoming.t_ns <= sample.t_ns:
            newest, upcoming = upcoming, next(commands, None)
        moving = max(abs(sample.v_m_s), 0.25 * abs(sample.w_rad_s))
        if newest.commanded:
            stopped_ns = None
        elif stopped_ns is None:
            stopped_ns, speed = sample.t_ns, moving
        elif sample.t_ns - stopped_ns > (speed / BRAKING_M_S2 + _LAG_S) * NS_PER_S and moving > _SETTLED_M_S:
            return True
    return False


def _beyond_cap(trace: Trace, config: Config) -> bool:
    """Faster than the phase allows, after the time that it takes to slow down to it; near the goal by truth."""
    goal_m = config.docking.goal(1).x_m
    near = [s for s in trace.world if not s.locked and 0.0 < -s.x_m - goal_m < _LAST_METRE_M]
    first_near = near[0].t_ns if near else 0
    if any(s.v_m_s > _LAST_METRE_M_S + _CAP_SPARE_M_S and s.t_ns - first_near > 0.6 * NS_PER_S for s in near):
        return True
    ends = [*(sample.t_ns for sample in trace.missions[1:]), 2**63]
    for mission, end in zip(trace.missions, ends, strict=False):
        cap = _CAPS_M_S.get(mission.phase, 0.0)
        begin = mission.t_ns + round(1.4 * NS_PER_S)
        if any(begin <= s.t_ns < end and abs(s.v_m_s) > cap + _CAP_SPARE_M_S for s in trace.world):
            return True
    return False


def _stale(trace: Trace) -> bool:
    """Wheels commanded although the genuine controller's newest command is older than 120 ms, or faster than any."""
    times = [command.t_ns for command in trace.commands]
    for sample in trace.bus:
        if not sample.commanded or sample.t_ns - trace.fault_ns < _STALE_NS:
            continue
        newest = bisect_right(times, sample.t_ns)
        if newest == 0 or sample.t_ns - times[newest - 1] > _STALE_NS:
            return True
        recent = [c for c in trace.commands[max(0, newest - 9) : newest] if sample.t_ns - c.t_ns < NS_PER_S // 2]
        if len(recent) > 5 and abs(sample.v_m_s) > max(abs(c.v_m_s) for c in recent) + _CAP_SPARE_M_S:
            return True
    return False


def _released(trace: Trace) -> bool:
    """The grippers lost a trolley that the lock does not hold."""
    pairs = zip(trace.world, trace.world[1:], strict=False)
    return any(before.holding and not after.holding and not after.locked for before, after in pairs)


def _unlocked(trace: Trace) -> bool:
    """The bolt went back while the robot moved, or from a trolley that it held."""
    pairs = zip(trace.world, trace.world[1:], strict=False)
    return any(b.travel < a.travel and (a.locked or abs(b.v_m_s) > _SETTLED_M_S) for a, b in pairs)


def _blind(trace: Trace) -> bool:
    assert trace.blind_ns is not None
    return any(s.commanded and s.v_m_s > 0.005 and s.t_ns - trace.blind_ns > _BLIND_NS for s in trace.bus)


def _pushes_back(trace: Trace) -> bool:
    """After the stop the arms go on pushing harder than before, for longer than 0.2 s."""
    zero_ns = next((s.t_ns for s in trace.bus if not s.commanded and s.t_ns > trace.fault_ns), None)
    if zero_ns is None or not trace.world:
        return False
    first: WorldSample = trace.world[0]
    late = (s for s in trace.world if s.t_ns - zero_ns > _PUSH_BACK_NS)
    return any(s.pushing and s.force_n > first.force_n + _PUSH_BACK_N for s in late)


def _same(trace: Trace, reference: list[BusSample]) -> bool:
    """The bus carried the same set-points as without the fault, to the bit."""
    known = {s.t_ns: (s.v_m_s, s.w_rad_s) for s in reference}
    return all(known.get(s.t_ns, (s.v_m_s, s.w_rad_s)) == (s.v_m_s, s.w_rad_s) for s in trace.bus)


def _overrun(phase: str, trace: Trace, config: Config) -> bool:
    """Backed further than what it had to go, without eyes behind."""
    if phase not in ("retract", "staging") or not trace.world:
        return False
    limit_m = config.supervisor.retract_distance_m if phase == "retract" else config.docking.staging_distance_m
    start_x = trace.world[0].x_m
    return max(start_x - sample.x_m for sample in trace.world) > limit_m + _OVERRUN_M
