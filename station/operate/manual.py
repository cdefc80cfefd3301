"""The robot moved by hand: ask for the manual mode, command while it is held, release.

Nothing goes past the gate: the supervisor arms, the gate judges each command as one of the controller's, and both
stop when commands cease. What is here only asks, commands, and waits.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, Self

from common.channels import ARM_STATE, COMMAND, DRIVES, MANUAL_REQUEST, MISSION
from common.errors import DeviceError
from common.messages import Answer, ArmState, Command, Drives, ManualRequest, Mission, seal_command
from common.timing import NS_PER_MS, NS_PER_S
from station.operate.link import RobotLink

OPERATOR = "operator"
PERIOD_NS = NS_PER_S // 50
_LIFETIME_NS = 100 * NS_PER_MS
_PATIENCE_S = 3.0
_ARMING_NS = 4 * NS_PER_S
Twist = tuple[float, float]


@dataclass(frozen=True)
class ManualFeedback:
    """The robot's newest state; None is what is missing or too old."""

    now_ns: int
    mission: Mission | None
    drives: Drives | None
    arms: ArmState | None


class ManualLink:
    """Connection of the one operator who moves a robot by hand; a context manager that ends the mode.

    Args:
        runtime: folder of the running robot's sockets.
        namespace: of the pair.
    """

    def __init__(self, runtime: Path, namespace: str) -> None:
        self._link = RobotLink(runtime, namespace, OPERATOR)
        self._watch = self._link.watch(MISSION, DRIVES, ARM_STATE)
        self._sequence = 0
        self._accepted = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._link:
            if self._accepted:
                self._ask("stop")

    def hold(
        self,
        steer: Callable[[ManualFeedback], Twist | None],
        grip: Literal["open", "closed", "stay"] = "stay",
        lift_m: float | None = None,
    ) -> str:
        """Command what ``steer`` gives [m/s, rad/s], 50 times a second, until it gives None.

        Returns:
            Why the robot ended it; empty when ``steer`` did.

        Raises:
            DeviceError: no answer, or the supervisor refuses; one line that says why.
        """
        answer = self._ask("start", grip, lift_m)
        if answer.outcome != "accepted":
            raise DeviceError(f"{answer.outcome}: {answer.reason}")
        self._accepted = True
        due_ns = start_ns = self._link.now_ns
        armed = False
        while True:
            feedback = self._feedback()
            mission, drives = feedback.mission, feedback.drives
            if mission is not None and mission.phase == "manual":
                armed = armed or (drives is not None and drives.state == "armed" and drives.epoch == mission.epoch)
                twist = steer(feedback) if armed else (0.0, 0.0)
                if twist is None:
                    return ""
                self._command(twist, mission.epoch)
            elif armed:
                return mission.cause if mission is not None else "the supervisor sends nothing any more"
            if not armed and feedback.now_ns - start_ns > _ARMING_NS:
                return _not_armed(feedback)
            due_ns = max(due_ns + PERIOD_NS, feedback.now_ns)
            self._link.clock.sleep_until(due_ns)

    def _feedback(self) -> ManualFeedback:
        fresh = self._watch.fresh
        return ManualFeedback(self._link.now_ns, fresh(MISSION), fresh(DRIVES), fresh(ARM_STATE))

    def _command(self, twist: Twist, epoch: int) -> None:
        now_ns = self._link.now_ns
        self._sequence += 1
        command = Command(twist[0], twist[1], epoch, self._sequence, now_ns, now_ns + _LIFETIME_NS, 0, now_ns)
        self._link.publish(COMMAND, seal_command(command))

    def _ask(
        self,
        action: Literal["start", "stop"],
        grip: Literal["open", "closed", "stay"] = "stay",
        lift_m: float | None = None,
    ) -> Answer:
        expires_ns = self._link.now_ns + round(_PATIENCE_S * NS_PER_S)
        request = ManualRequest(f"manual-{secrets.token_hex(4)}", expires_ns, action, grip, lift_m)
        return self._link.ask(MANUAL_REQUEST, request, _PATIENCE_S)


def _not_armed(feedback: ManualFeedback) -> str:
    if feedback.drives is None:
        return "the drives were not armed: the CAN bridge sends nothing"
    return f"the drives were not armed: {feedback.drives.state} {feedback.drives.cause}".rstrip()


class Keys:
    """Arrow keys as a hold-to-run control: a key that is held repeats, and one that no longer does is released.

    A terminal reports no release. The first stroke holds until the keyboard begins to repeat, each further one for
    three repeats; any other key, and space, stops at once.
    """

    FIRST_NS = 550 * NS_PER_MS
    REPEAT_NS = 150 * NS_PER_MS
    TWISTS: ClassVar[dict[str, Twist]] = {
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
            known = [key for key in self.TWISTS if typed.endswith(key)]
            key = known[0] if known else ""
            held = key and key == self._key and now_ns < self._until_ns
            self._until_ns = now_ns + (self.REPEAT_NS if held else self.FIRST_NS)
            self._key = key
        if now_ns >= self._until_ns:
            self._key = ""
        ahead, turn = self.TWISTS.get(self._key, (0.0, 0.0))
        return ahead * self._most[0], turn * self._most[1]


class Fingers:
    """Whether the grippers have done what was asked: open, or closed until they stop moving."""

    def __init__(self, wanted: Literal["open", "closed"], still_ns: int = NS_PER_S) -> None:
        self._wanted, self._still_ns = wanted, still_ns
        self._angles: tuple[float, float] | None = None
        self._since_ns = 0

    def step(self, feedback: ManualFeedback) -> Twist | None:
        """Zero twists until it is done."""
        if feedback.drives is None or feedback.arms is None:
            return 0.0, 0.0
        angles = feedback.drives.grip_angle_rad
        if self._angles is None or max(abs(a - b) for a, b in zip(angles, self._angles, strict=True)) > 0.01:
            self._angles, self._since_ns = angles, feedback.now_ns
        still = feedback.now_ns - self._since_ns >= self._still_ns
        return None if still or (self._wanted == "open" and feedback.arms.released) else (0.0, 0.0)
