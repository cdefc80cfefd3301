"""A docking sequence with an obedient robot around it: what the tests of the supervisor and beside it share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

from common.config import Config
from common.geometry import Pose2, features_at
from common.messages import Answer, ArmState, DockingState, DockRequest, Drives, LeaderState, LockRequest, Mission
from common.timing import NS_PER_S
from follower.supervisor.interface import SupervisorInputs, SupervisorOutputs
from follower.supervisor.sequence import DockingSequence

STEP_NS = NS_PER_S // 20


def docking_state(config: Config, pose: Pose2, valid: bool = True) -> DockingState:
    filtered = tuple((float(a), float(b)) for a, b in features_at(config.leds.points, pose, config.camera.mount))
    return DockingState(
        1, 0, valid, "ok" if valid else "few_leds", 4, (None,) * 4, filtered if valid else (), None,
        pose.x_m, pose.y_m, pose.theta_rad, (0.0,) * 9, (0.0,) * 4, None, None, 0.1, 4, 1, 0,
    )  # fmt: skip


DRIVES = Drives(
    "disarmed", "", 0, 0, (0.0, 0.0), (0.0, 0.0), (0.0,) * 6, (0.0,) * 6, (0.0, 0.0), (0.0, 0.0), 0.2,
    True, 25.0, 0.0, 0.0, 0, 0, 0,
)  # fmt: skip
ARMS = ArmState(5.0, False, False, True, False)
LEADER = LeaderState(True, "", (1.0,) * 4, False, "down", "open", 0.0, 0)


@dataclass
class Bench:
    """A sequence with an obedient robot around it."""

    config: Config
    sequence: DockingSequence = field(init=False)
    seen: SupervisorInputs = field(init=False)
    mission: Mission | None = None
    lock_requests: list[LockRequest] = field(default_factory=list)
    rolled_m: float = 0.0

    def __post_init__(self) -> None:
        self.sequence = DockingSequence(self.config, run_id=1000)
        far = docking_state(self.config, Pose2(5.0, 0.1, 0.0))
        self.seen = SupervisorInputs(
            now_ns=NS_PER_S, state=far, drives=DRIVES, arms=ARMS, leader=LEADER, controller_alive=True
        )

    def step(self, **changes: Any) -> SupervisorOutputs:
        """Observe once with changes that stay."""
        self.seen = replace(self.seen, now_ns=self.seen.now_ns + STEP_NS, **changes)
        if self.seen.drives is not None:
            self.seen = replace(self.seen, drives=replace(self.seen.drives, measured_ns=self.seen.now_ns))
        decided = self.sequence.step(self.seen)
        self.seen = replace(self.seen, requests=(), lock_answers=())
        self.mission = decided.mission
        if decided.lock_request:
            self.lock_requests.append(decided.lock_request)
        drives = self.seen.drives
        if drives is not None and drives.state in ("disarmed", "armed"):
            state: Literal["armed", "disarmed"] = "armed" if decided.mission.armed else "disarmed"
            self.seen = replace(self.seen, drives=replace(drives, state=state, epoch=decided.mission.epoch))
        return decided

    def run(self, seconds: float, **changes: Any) -> str:
        """Observe for a while; the phase at the end."""
        self.step(**changes)
        for _ in range(round(seconds * 20) - 1):
            self.step()
        return self.sequence.phase

    def ask(self, action: Literal["start", "abort", "reset"], **kwargs: Any) -> Answer:
        """Send a request; its answer."""
        request = DockRequest(f"{action}-{self.seen.now_ns}", self.seen.now_ns + NS_PER_S, action, **kwargs)
        (answer,) = self.step(requests=(request,)).answers
        return answer

    def turn_while_searching(self) -> list[float]:
        """Let the base turn as commanded until the search is over; headings on the way."""
        headings = [0.0]
        track, radius = self.config.base.track_m, self.config.base.wheel_radius_m
        for _ in range(20 * 60):
            if self.sequence.phase != "search" or self.mission is None or self.seen.drives is None:
                break
            turn_rad_s = self.mission.turn_rate_rad_s if self.mission.motion == "turn" else 0.0
            headings.append(headings[-1] + turn_rad_s / 20)
            angle = headings[-1] * track / 2 / radius
            self.step(drives=replace(self.seen.drives, wheel_angle_rad=(-angle, angle)))
        return headings

    def roll(self, metres: float) -> Drives:
        """The drives after rolling that far since the insertion began."""
        angle = (self.rolled_m + metres) / self.config.base.wheel_radius_m
        assert self.seen.drives is not None
        return replace(self.seen.drives, wheel_angle_rad=(angle, angle))

    def to_approach(self) -> None:
        self.run(0.2)  # it stood before
        assert self.ask("start").outcome == "accepted"
        assert self.run(0.7) == "approach"

    def there(self, pose: Pose2) -> dict[str, Any]:
        """State and drives after a way that the odometry does not see: as after a jump of its encoders."""
        self.rolled_m += 5.0
        return {"state": docking_state(self.config, pose), "drives": self.roll(0.0)}

    def to_insert(self) -> None:
        self.to_approach()
        assert self.run(self.config.docking.settle_s + 0.2, **self.there(self.config.docking.goal(1))) == "insert"

    def to_push(self) -> None:
        self.to_insert()
        self.step()
        self.step(drives=self.roll(0.06), arms=replace(ARMS, contact=True))
        assert self.sequence.phase == "push"

    def to_lock(self) -> None:
        self.to_push()
        goal = self.config.docking.goal(1)
        docked = docking_state(self.config, Pose2(goal.x_m - 0.14, 0.0, 0.0))
        self.step(drives=self.roll(0.14), arms=replace(ARMS, contact=True, connected=True), state=docked)
        assert self.sequence.phase == "lock"
