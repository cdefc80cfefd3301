"""A person's hand on a running robot: ask for the manual mode, command while it is held, let go.

Nothing goes past the gate: the supervisor arms, the gate judges each command as one of the controller's, and both
stop when commands cease. What is here only asks, commands, and waits.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from common.bus import Bus
from common.channels import ARM_STATE, COMMAND, DRIVES, MANUAL_REQUEST, MISSION, Channel
from common.errors import DeviceError
from common.executor import earlier_processes
from common.messages import Answer, ArmState, Command, Drives, ManualRequest, Mission, decode, seal_command
from common.node import Inbox, Outbox
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock

OPERATOR = "operator"
PERIOD_NS = NS_PER_S // 50
_LIFETIME_NS = 100 * NS_PER_MS
_ANSWER_S = 1.0
_ATTEMPTS = 3
_ARMING_NS = 4 * NS_PER_S
Twist = tuple[float, float]


@dataclass(frozen=True)
class Felt:
    """What the robot said last; None is what is missing or too old."""

    now_ns: int
    mission: Mission | None
    drives: Drives | None
    arms: ArmState | None


class ManualLink:
    """Connection of one station; a context manager that lets go at its end.

    Args:
        runtime: folder of the running robot's sockets.
        namespace: of the pair.
    """

    def __init__(self, runtime: Path, namespace: str) -> None:
        self._clock = MonotonicClock()
        self._inbox = Inbox(self._clock.boot_id)
        self._outbox = Outbox(OPERATOR, secrets.randbits(62), self._clock.boot_id)
        self._sequence = 0
        self._asked = False
        self._bus = Bus(OPERATOR, runtime, earlier_processes(OPERATOR), namespace)
        for channel in (MISSION, DRIVES, ARM_STATE):
            self._bus.subscribe(channel, self._receiver(channel))

    def __enter__(self) -> ManualLink:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if self._asked:
                self._ask("stop")
        finally:
            self._bus.close()

    def hold(
        self,
        steer: Callable[[Felt], Twist | None],
        grip: Literal["open", "closed", "stay"] = "stay",
        lift_m: float | None = None,
    ) -> str:
        """Command what ``steer`` gives [m/s, rad/s], 50 times a second, until it gives None.

        Returns:
            Why the robot ended it; empty when ``steer`` did.

        Raises:
            DeviceError: nobody answers, or the supervisor refuses; one line that says why.
        """
        answer = self._ask("start", grip, lift_m)
        if answer.outcome != "accepted":
            raise DeviceError(f"{answer.outcome}: {answer.reason}")
        self._asked = True
        due_ns = start_ns = self._clock.now_ns()
        armed = False
        while True:
            felt = self._felt()
            by_hand = felt.mission is not None and felt.mission.phase == "manual"
            if felt.mission is not None and by_hand:
                ready = felt.drives is not None and felt.drives.state == "armed"
                armed = armed or (ready and felt.drives is not None and felt.drives.epoch == felt.mission.epoch)
                twist = steer(felt) if armed else (0.0, 0.0)
                if twist is None:
                    return ""
                self._command(twist, felt.mission.epoch)
            elif armed:
                return felt.mission.cause if felt.mission is not None else "the supervisor fell silent"
            if not armed and felt.now_ns - start_ns > _ARMING_NS:
                return _not_armed(felt)
            due_ns = max(due_ns + PERIOD_NS, felt.now_ns)
            self._clock.sleep_until(due_ns)

    def _felt(self) -> Felt:
        now_ns = self._clock.now_ns()
        self._inbox.begin_step()
        fresh = self._inbox.fresh
        return Felt(now_ns, fresh(MISSION, now_ns), fresh(DRIVES, now_ns), fresh(ARM_STATE, now_ns))

    def _command(self, twist: Twist, epoch: int) -> None:
        now_ns = self._clock.now_ns()
        self._sequence += 1
        told = Command(twist[0], twist[1], epoch, self._sequence, now_ns, now_ns + _LIFETIME_NS, 0, now_ns)
        self._bus.publish(COMMAND, self._outbox.pack(COMMAND, seal_command(told), now_ns))

    def _ask(
        self,
        action: Literal["start", "stop"],
        grip: Literal["open", "closed", "stay"] = "stay",
        lift_m: float | None = None,
    ) -> Answer:
        """Ask again with the same id until somebody answers: it is carried out once."""
        now_ns = self._clock.now_ns()
        expires_ns = now_ns + round(_ATTEMPTS * _ANSWER_S * NS_PER_S)
        request = ManualRequest(f"manual-{secrets.token_hex(4)}", expires_ns, action, grip, lift_m)
        for _ in range(_ATTEMPTS):
            payload = self._outbox.pack(MANUAL_REQUEST, request, self._clock.now_ns())
            reply = self._bus.request(MANUAL_REQUEST, payload, _ANSWER_S)
            if reply is not None:
                return decode(Answer, reply)[1]
        raise DeviceError("the supervisor does not answer")

    def _receiver(self, channel: Channel[Mission] | Channel[Drives] | Channel[ArmState]) -> Callable[[bytes], None]:
        return lambda payload: self._inbox.put_state(channel, payload, self._clock.now_ns())


def _not_armed(felt: Felt) -> str:
    if felt.drives is None:
        return "the drives do not get armed: the CAN bridge is silent"
    return f"the drives do not get armed: {felt.drives.state} {felt.drives.cause}".rstrip()


class Keys:
    """Arrow keys as a held-to-run control: a key that is held repeats, and one that no longer does is let go.

    A terminal tells no release. The first stroke holds until the keyboard begins to repeat, each further one for
    three repeats; any other key, and space, stops at once.
    """

    FIRST_NS = 550 * NS_PER_MS
    REPEAT_NS = 150 * NS_PER_MS
    WAYS: ClassVar[dict[str, Twist]] = {
        "\x1b[A": (1.0, 0.0),
        "\x1b[B": (-1.0, 0.0),
        "\x1b[D": (0.0, 1.0),
        "\x1b[C": (0.0, -1.0),
    }

    def __init__(self, speed_m_s: float, turn_rad_s: float) -> None:
        self._most = speed_m_s, turn_rad_s
        self._key = ""
        self._until_ns = 0

    def step(self, now_ns: int, typed: str) -> Twist:
        """The twist for what was typed since the last step, escape sequences of arrow keys."""
        if typed:
            known = [key for key in self.WAYS if typed.endswith(key)]
            key = known[0] if known else ""
            held = key and key == self._key and now_ns < self._until_ns
            self._until_ns = now_ns + (self.REPEAT_NS if held else self.FIRST_NS)
            self._key = key
        if now_ns >= self._until_ns:
            self._key = ""
        ahead, turn = self.WAYS.get(self._key, (0.0, 0.0))
        return ahead * self._most[0], turn * self._most[1]


class Fingers:
    """Whether the grippers have done what was asked: open, or closed until they move no more."""

    def __init__(self, wanted: Literal["open", "closed"], still_ns: int = NS_PER_S) -> None:
        self._wanted, self._still_ns = wanted, still_ns
        self._angles: tuple[float, float] | None = None
        self._since_ns = 0

    def step(self, felt: Felt) -> Twist | None:
        """Zero twists until it is done."""
        if felt.drives is None or felt.arms is None:
            return 0.0, 0.0
        angles = felt.drives.grip_angle_rad
        if self._angles is None or max(abs(a - b) for a, b in zip(angles, self._angles, strict=True)) > 0.01:
            self._angles, self._since_ns = angles, felt.now_ns
        still = felt.now_ns - self._since_ns >= self._still_ns
        return None if still or (self._wanted == "open" and felt.arms.released) else (0.0, 0.0)
