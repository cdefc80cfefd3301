"""The rows of docs/safety.md: what is expected of each, in which phases it matters, and what injects it.

The texts are those of docs/safety.md. ``process`` names the test that covers a row, or the rest of one, with real
processes; a row without faults has no form in stepped time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Reaction = Literal["none", "S0", "S1", "S2", "refuse"]
CONTACT = ("insert", "push", "lock", "release")
VISUAL = ("approach", "last_metre", "insert", "push")
MOVING = ("staging", "search", *VISUAL, "retract")
ARMED = ("staging", "search", *VISUAL, "lock", "release", "retract")
LATE = ("command_age", "valid_until")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row.

    Attributes:
        id: S01 … S49.
        what: the fault, and reaction as docs/safety.md has it.
        reaction: those that are right; in ``idle`` it is always "refuse": nothing may be armed.
        limit_ms: time to the reaction; None: the row sets none.
        faults: names of :data:`experiments.campaign.faults.FAULTS`, taken in turn over seeds and phases.
        phases: in which it matters.
        causes: codes that are right as first cause; one that ends with * is looked for within the text.
        ends: causes that are right where the docking is followed to its end; empty: not judged.
        observe_s, idle_s: for how long a run is watched after its fault.
        stays: nothing may move again by itself.
        identical: the bus must carry the same set-points as without the fault, to the bit.
        lets_go: the fault itself takes the trolley from the grippers.
        pushes_not: the arms must not push back.
        reduced: it must have slowed down to 0.1 m/s, as with a LED missing.
        slow: faults that take time until there is anything to notice: no limit counts from their begin.
        ahead: faults that need free floor ahead: not injected in contact.
        false_locks: the fault itself falsifies the docking state.
        process: what covers it with real processes.
    """

    id: str
    what: str
    reaction: tuple[Reaction, ...] = ()
    limit_ms: float | None = None
    faults: tuple[str, ...] = ()
    phases: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    ends: tuple[str, ...] = ()
    observe_s: float = 2.0
    idle_s: float = 7.0
    stays: bool = False
    identical: bool = False
    lets_go: bool = False
    pushes_not: bool = False
    reduced: bool = False
    slow: tuple[str, ...] = ()
    ahead: tuple[str, ...] = ()
    false_locks: bool = False
    process: str = ""

    def expected(self, phase: str, still: bool) -> tuple[str, ...]:
        """Reactions that are right in a phase: what ends a docking in contact latches; who stands need not pause."""
        if phase == "idle":
            return ("refuse",)
        allowed: tuple[str, ...] = self.reaction
        if "S1" in allowed and phase in (*CONTACT, "retract"):
            allowed += ("S2",)
        if "S0" in allowed and still:
            allowed += ("none",)
        return allowed

    def usable(self, phase: str) -> tuple[str, ...]:
        """Faults that can happen in a phase."""
        return tuple(name for name in self.faults if name not in self.ahead or phase not in CONTACT)

    def tasks(self, index: int) -> list[tuple[str, str]]:
        """Phase and fault in the seed of this index; over the seeds every fault comes in every phase."""
        choices = [(phase, self.usable(phase)) for phase in self.phases]
        return [(phase, usable[(index + i) % len(usable)]) for i, (phase, usable) in enumerate(choices)]


_DOCKED = ("done",)
_ELSEWHERE = "the LEDs are not where odometry expects them"
_STILL = "the image does not follow the wheels"
_ROWS = (
    Row(id="S01", what="controller SIGKILL: S1, stop time ≤ 150 ms", reaction=("S1",), limit_ms=150,
        faults=("controller_dead",), phases=MOVING, causes=LATE, process="stop-times controller_kill"),
    Row(id="S02", what="controller stalled: S1 ≤ 150; the old epoch is refused", reaction=("S1",), limit_ms=150,
        faults=("controller_hung",), phases=MOVING, causes=LATE, ends=(*_DOCKED, "gate_stop"),
        process="stop-times controller_stop"),
    Row(id="S03", what="estimator dead or hung: S0 ≤ 250", reaction=("S0",), limit_ms=250,
        faults=("estimator_dead", "estimator_hung"), phases=("search", *VISUAL), causes=("no docking state",),
        ends=(*_DOCKED, "estimator_silent", "unwell"), process="stop-times estimator_kill"),
    Row(id="S04", what="camera dead or unplugged: S0 ≤ 250", reaction=("S0",), limit_ms=250,
        faults=("camera_dead", "camera_unplugged", "camera_hung"), phases=("search", *VISUAL),
        causes=("no_frame*", "stale_frame*", "coasting*", "no docking state"),
        ends=(*_DOCKED, "camera_silent", "leds_lost"), process="stop-times camera_kill"),
    Row(id="S05", what="supervisor dead or hung: S1 ≤ 250", reaction=("S1",), limit_ms=250,
        faults=("supervisor_dead", "supervisor_hung"), phases=ARMED, causes=("token_age",),
        process="stop-times supervisor_kill"),
    Row(id="S06", what="can_bridge dead or hung: quick stop ≤ 120 ms after the last RPDO, latched; restarts disarmed",
        reaction=("S1",), limit_ms=120, faults=("bridge_dead", "bridge_hung"), phases=ARMED,
        causes=("drives_silent", "bridge_stalled", "drives*"), process="stop-times bridge_kill, bridge_stop"),
    Row(id="S07", what="stale frame: drop, coast ≤ 100 ms, S0", reaction=("S0",), limit_ms=250,
        faults=("frames_late",), phases=VISUAL, causes=("stale_frame*",), ends=("camera_silent", "leds_lost")),
    Row(id="S08", what="frozen camera: S0 ≤ 200", reaction=("S0",), limit_ms=200,
        faults=("frozen", "frozen_noisy"), phases=VISUAL, causes=("frozen_camera*", _STILL),
        ends=("camera_silent", "leds_lost", "not_following")),
    Row(id="S09", what="over- or under-exposure: one exposure retry, S0", reaction=("S0",), limit_ms=250,
        faults=("overexposed", "underexposed"), phases=VISUAL, causes=("overexposed*", "underexposed*"),
        ends=("leds_lost", "unwell")),
    Row(id="S10", what="1 of 4 LEDs dead: goes on at ≤ 0.1 m/s while σ of e_y at the goal is < 2 cm, else S0",
        reaction=("none", "S0"), reduced=True, faults=("led_dead",), phases=(*VISUAL, "lock"),
        causes=("too few LEDs*", "few_leds*", "ambiguous*", "residual*", "not_identified*", "confirming*"),
        ends=(*_DOCKED, "few_leds")),
    Row(id="S11", what="≥ 2 LEDs lost, occlusion: S0 after 100 ms of prediction; search ≤ 3×", reaction=("S0",),
        limit_ms=250, faults=("leds_hidden", "leds_dead"), phases=VISUAL,
        causes=("few_leds*", "not_identified*", "ambiguous*"), ends=(*_DOCKED, "leds_lost")),
    Row(id="S12", what="false blobs, a second array: two candidates = reject; S0 if > 200 ms",
        reaction=("none", "S0"), limit_ms=300, faults=("second_array", "false_blobs"), phases=VISUAL,
        causes=("ambiguous*", "residual*", "not_identified*", _ELSEWHERE, "noisy*")),
    Row(id="S13", what="match swap, pose flip: reject; S0", reaction=("S0",), limit_ms=250,
        faults=("theta_flip", "depth_jump"), phases=("approach", "last_metre"), ends=_DOCKED,
        causes=(_ELSEWHERE,), false_locks=True),
    Row(id="S14", what="NaN or Inf in any message: drop; S1 after 2", reaction=("S1",), limit_ms=250,
        faults=("nan_command", "nan_state", "nan_mission", "nan_drives", "nan_arms", "nan_torques"), phases=VISUAL,
        causes=(*LATE, "token_age", "arm_setpoint_age", "bad_message", "malformed*", "no docking state",
                "arms silent", "no drives")),
    Row(id="S15", what="solver failed: previous plan ≤ 2 cycles, then S0", reaction=("S0",), limit_ms=250,
        faults=("solver_fails",), phases=("approach", "last_metre"), ends=("no_progress",)),
    Row(id="S16", what="solver late: nothing published; expires; never a late command", reaction=("S1",),
        limit_ms=150, faults=("solver_late",), phases=MOVING, causes=LATE),
    Row(id="S17", what="observer wind-up: clamp", reaction=("none", "S0"), faults=("wheels_misread",),
        phases=("approach", "last_metre"), causes=(_STILL, "the LEDs*", "LEDs not acquired*")),
    Row(id="S18", what="wall clock jumps ± 1 h: no effect", reaction=("none",), faults=("clock_jumps",),
        phases=ARMED, identical=True, observe_s=1.2, ends=_DOCKED, process="tests/system/test_gaps.py"),
    Row(id="S19", what="CAN bus-off: S1; recovers only disarmed", reaction=("S1",), limit_ms=150,
        faults=("bus_off", "bus_off_briefly"), phases=ARMED, causes=("drive_fault", "bus*", "CAN*")),
    Row(id="S20", what="drive fault, EMCY: S2 both wheels ≤ 20", reaction=("S2",), limit_ms=20,
        faults=("wheel_fault", "joint_fault", "gripper_fault"), phases=("acquire", *ARMED),
        causes=("wheel*", "joint*", "grip*", "arm*", "left*", "right*", "drive_fault")),
    Row(id="S21", what="one drive silent: S1 both wheels ≤ 100", reaction=("S1",), limit_ms=100,
        faults=("wheel_silent", "joint_silent"), phases=ARMED, causes=("node_silent", "status_age")),
    Row(id="S22", what="encoder jump, stuck, sign flip; angle against speed and vision: S1 within 300 ms",
        reaction=("S1",), limit_ms=350, phases=MOVING,
        faults=("angle_stuck", "speed_stuck", "angle_jump", "sign_flip", "angle_backwards", "angle_half",
                "joint_jump"),
        causes=("measured_jump", "measured_gap", "measured_stuck", "measured*", "arm_jump"), observe_s=5.0),
    Row(id="S23", what="CAN frame corrupt, replayed, wrong DLC: drop; S1 after 3", reaction=("S1",), limit_ms=150,
        faults=("can_truncated", "can_replayed"), phases=ARMED, causes=("bad_frames", "node_silent", "status_age")),
    Row(id="S24", what="partition: the approach goes on, commands unchanged; the lock step waits; HOLD in contact",
        reaction=("none",), faults=("link_cut",), phases=ARMED, identical=True, observe_s=1.2,
        ends=("done", "leader_silent"), process="davpc experiment linkcut"),
    Row(id="S25", what="gateway killed: none; then as S24", reaction=("none",), faults=("link_cut",),
        phases=("approach", "push"), identical=True, observe_s=1.2, process="tests/net/test_two_robots.py"),
    Row(id="S26", what="reordered, duplicated, old message: drop, count", reaction=("none",),
        faults=("commands_reordered", "commands_doubled", "states_doubled"), phases=MOVING, ends=_DOCKED),
    Row(id="S27", what="burst after a stall: 0 stale set-points", reaction=("S1",), limit_ms=150,
        faults=("burst",), phases=MOVING, causes=LATE, process="stop-times stall"),
    Row(id="S28", what="disk full: control goes on; a new dock is refused", reaction=("none",),
        faults=("disk_full",),
        phases=("idle", *VISUAL, "lock", "release", "retract"), identical=True, observe_s=1.2, idle_s=3.0,
        causes=("reports cannot be written",)),
    Row(id="S29", what="CPU overload, 3 late loops > 20 ms: S0", reaction=("S0",), limit_ms=300,
        faults=("late_loops",), phases=MOVING, causes=("runs late*",), ends=_DOCKED),
    Row(id="S30", what="out of memory: as a crash of that unit", process="tests/deploy/test_units.py, S01–S06"),
    Row(id="S31", what="config wrong or out of range: never arm, clear error", reaction=("refuse",),
        faults=("config_radius", "config_gear", "config_cap"), phases=("idle",), process="tests/unit/common"),
    Row(id="S32", what="calibration missing, of another camera, too old: never arm", reaction=("refuse",),
        faults=("calibration_missing",), phases=("idle",), causes=("calibration*",)),
    Row(id="S33", what="e-stop: S2 ≤ 50", reaction=("S2",), limit_ms=50, faults=("estop", "protective_stop"),
        phases=("acquire", *ARMED), causes=("stop_input",)),
    Row(id="S34", what="operator abort: S1 ≤ 150",
        reaction=("S1",), limit_ms=150, faults=("abort",), phases=("acquire", *ARMED),
        causes=("operator_abort",), stays=True),
    Row(id="S35", what="Leader power lost: S0; HOLD in contact", reaction=("S0",), limit_ms=250,
        faults=("leader_off",), phases=(*VISUAL, "lock"),
        causes=("few_leds*", "not_identified*", "ambiguous*", "the Leader's link", "leader_silent"),
        ends=("leader_lost", "leader_silent")),
    Row(id="S36", what="lock jams: retract once, then S2 HOLD", reaction=("S2",), faults=("bolt_blocked",),
        phases=("push", "lock"), causes=("lock_refused",), observe_s=12.0),
    Row(id="S37", what="switch stuck closed: never arm / S2", reaction=("S2",), faults=("switch_closed",),
        phases=("idle", "insert", "push"),
        causes=("lock_refused", "lock_implausible", "the Leader's lock has a fault"), observe_s=11.0),
    Row(id="S38", what="trolley slips from the grippers: S1, no pursuit", reaction=("S1", "S2"), limit_ms=150,
        faults=("one_hand_slips", "both_hands_slip"), phases=(*VISUAL, "lock"), causes=("slip",), lets_go=True,
        stays=True),
    Row(id="S39", what="torque spike, collision: S2, no push-back > 0.2 s", reaction=("S2",), limit_ms=100,
        faults=("torque_spike", "obstacle"), phases=("approach", "last_metre", "push", "lock"),
        causes=("collision", "contact_early"),
        pushes_not=True, stays=True, slow=("obstacle",), ahead=("obstacle",)),
    Row(id="S40", what="wheel slip, blocked wheel: measured against visual speed for 300 ms: S0",
        reaction=("S0", "S1", "S2"), limit_ms=1000, faults=("wheels_slip", "wheel_blocked"),
        phases=("approach", "last_metre"), causes=(_STILL, "measured_gap", "measured_stuck", "collision")),
    Row(id="S41", what="any process restarts mid-dock: disarmed, never resumed", reaction=("S1",), limit_ms=250,
        faults=("restart_camera", "restart_estimator", "restart_controller", "restart_supervisor",
                "restart_bridge", "restart_arms"),
        phases=("search", *VISUAL, "retract"), stays=True, observe_s=3.0),
    Row(id="S42", what="two controllers publish: S1", reaction=("S1",), limit_ms=150, faults=("second_controller",),
        phases=MOVING, causes=("second_writer",), stays=True),
    Row(id="S43", what="rogue or replayed command: 0 accepted", reaction=("none",),
        faults=("old_epoch", "forged", "other_boot", "replay"), phases=MOVING, ends=_DOCKED,
        process="tests/net/test_rogue.py"),
    Row(id="S44", what="flood: S0 if the gap > 120 ms; recovered ≤ 1 s after", process="tests/net/test_rogue.py"),
    Row(id="S45", what="certificate expires: > 24 h left is checked at arm; a running dock finishes",
        reaction=("none",), faults=("certificate",),
        phases=("idle", "approach", "push"), identical=True, observe_s=1.2, idle_s=3.0),
    Row(id="S46", what="undervoltage: S0, refuse to arm", reaction=("S0",), limit_ms=250, faults=("battery_low",),
        phases=("idle", *MOVING), causes=("battery*",), ends=("unwell", "staging_timeout"), idle_s=3.0),
    Row(id="S47", what="computer loses power: drives stop; no automatic restart", reaction=("S1",), limit_ms=120,
        faults=("computer_off",), phases=ARMED, stays=True),
    Row(id="S48", what="crash loop: 5 starts in 60 s → OnFailure, S2", process="tests/deploy/test_units.py"),
    Row(id="S49", what="arms dead or hung: S1 + HOLD", reaction=("S1",), limit_ms=150,
        faults=("arms_dead", "arms_hung"), phases=ARMED, causes=("arm_setpoint_age",),
        process="stop-times arms_kill"),
)  # fmt: skip
ROWS = {row.id: row for row in _ROWS}
