"""Grasp, hold, release, retract: commands to grippers, lift and the arms' reference, as a pure state machine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from common.config import ArmsConfig
from common.timing import NS_PER_MS, NS_PER_S, HeldFor
from follower.arms.sampling import SampleInterval, step_held

GraspStage = Literal["reach", "close", "hold", "relax", "open", "retract"]
_RELAX_NS = 300 * NS_PER_MS
_GLIDE_M_S = 0.10
_ARRIVED_M = 0.01
_CLOSE_SETTLE_NS = 200 * NS_PER_MS
_REST_RAD_S = 0.1


@dataclass(frozen=True)
class Grasp:
    """Commands now: grip torque [N·m], reference of the handle [m in {F}], lift [m], firmness 0 … 1."""

    stage: GraspStage
    grip_torque_n_m: float
    handle_x_m: float
    lift_m: float
    firmness: float


class GraspSequence:
    """Steps with each measurement, from :meth:`restart` on.

    Closing: ``reach`` to the handle's place and height, ``close``, ``hold``. Opening: ``relax`` the force first, so
    that nothing springs away, ``open``, ``retract``. In place, in manual mode, only fingers and lift
    move, and only on request.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._stage: GraspStage = "retract"
        self._stage_ns = self._now_ns = 0
        self._reference_m = config.handle_x_m
        self._firmness = 0.0
        self._angles_rad: tuple[float, float] | None = None
        self._at_rest = HeldFor(_CLOSE_SETTLE_NS)
        self._lift_m = config.lift_height_m

    def restart(self, handle_x_m: float, angles_rad: tuple[float, float], lift_m: float, now_ns: int) -> None:
        """Begin from where grippers and handle are; called while the drives are not enabled, so that nothing jumps.

        Args:
            handle_x_m: measured place of the handle along x of {F}.
            angles_rad: measured angles of the (left, right) finger.
            lift_m: measured height of the lift.
            now_ns: time of the sample before.
        """
        # fingers neither on a handle nor open may still hold one on one side: they stay closed
        self._stage = "hold" if self.gripped(angles_rad) else "retract" if self.released(angles_rad) else "close"
        self._stage_ns = self._now_ns = now_ns
        self._firmness = float(self._stage == "hold")
        self._reference_m = handle_x_m
        self._lift_m = lift_m

    def in_place(
        self,
        wanted: Literal["open", "closed", "stay"],
        lift_m: float | None,
        angles_rad: tuple[float, float],
        interval: SampleInterval,
    ) -> Grasp:
        """One step in manual mode: the arms stay where they were at :meth:`restart`.

        Args:
            wanted: of the fingers; ``stay`` leaves them as they are.
            lift_m: height of the lift; None: where it was.
            angles_rad: measured angles of the (left, right) finger.
            interval: from the sample before to this one.
        """
        self._now_ns = interval.end_ns
        following = self._stage if wanted == "stay" else self._next_in_place(wanted == "open", angles_rad)
        if following != self._stage:
            self._stage, self._stage_ns = following, interval.end_ns
        reference_m = self._reference_m
        grasp = self._wanted(self._stage, interval.dt_s)
        self._reference_m = reference_m
        return replace(grasp, handle_x_m=reference_m, lift_m=self._lift_m if lift_m is None else lift_m)

    def _next_in_place(self, opening: bool, angles_rad: tuple[float, float]) -> GraspStage:
        if opening:
            relaxed = self._stage != "hold" and (self._stage != "relax" or self._in_stage(_RELAX_NS))
            return "open" if relaxed else "relax"
        if self._stage in ("hold", "relax"):
            return "hold"
        settled = self._stage == "close" and self._in_stage(_CLOSE_SETTLE_NS)
        return "hold" if settled and self.gripped(angles_rad) else "close"

    def step(
        self,
        wanted: Literal["open", "closed"],
        angles_rad: tuple[float, float],
        lift_m: float,
        interval: SampleInterval,
    ) -> Grasp:
        """Take one step.

        Args:
            wanted: of the grippers.
            angles_rad: measured angles of the (left, right) finger.
            lift_m: measured height of the lift.
            interval: from the sample before to this one.
        """
        self._now_ns = interval.end_ns
        self._watch_fingers(angles_rad, interval)
        following = self._next(self._stage, wanted, angles_rad, lift_m)
        if following != self._stage:
            self._stage, self._stage_ns = following, interval.end_ns
        return self._wanted(self._stage, interval.dt_s)

    def _in_stage(self, least_ns: int) -> bool:
        """Whether the stage has lasted so long."""
        return self._now_ns - self._stage_ns >= least_ns

    def gripped(self, angles_rad: tuple[float, float]) -> bool:
        """Both grippers have closed on something."""
        config = self._config
        return all(config.grip_empty_rad < angle < config.grip_closed_rad for angle in angles_rad)

    def released(self, angles_rad: tuple[float, float]) -> bool:
        """Both grippers are open."""
        return all(angle > self._config.grip_open_rad for angle in angles_rad)

    def _watch_fingers(self, angles_rad: tuple[float, float], interval: SampleInterval) -> None:
        before, self._angles_rad = self._angles_rad, angles_rad
        moved = (
            before is None
            or max(abs(a - b) for a, b in zip(angles_rad, before, strict=True)) > _REST_RAD_S * interval.dt_s
        )
        step_held(self._at_rest, interval, not moved)

    def _next(self, stage: GraspStage, wanted: str, angles_rad: tuple[float, float], lift_m: float) -> GraspStage:
        config = self._config
        if wanted == "open":
            if stage == "hold":
                return "relax"
            if stage in ("reach", "close"):
                return "open"
            if stage == "relax" and self._in_stage(_RELAX_NS):
                return "open"
            return "retract" if stage == "open" and self.released(angles_rad) else stage
        if stage == "relax":
            return "hold"
        if stage in ("open", "retract"):
            return "reach"
        level = abs(lift_m - config.lift_height_m) < _ARRIVED_M
        if stage == "reach" and level and abs(self._reference_m - config.handle_x_m) < _ARRIVED_M:
            return "close"
        # fingers that close on nothing pass through the angles at which they would hold
        settled = stage == "close" and self._in_stage(_CLOSE_SETTLE_NS) and self._at_rest.on
        return "hold" if settled and self.gripped(angles_rad) else stage

    def _wanted(self, stage: GraspStage, dt_s: float) -> Grasp:
        config = self._config
        away = stage == "retract"
        step_m = _GLIDE_M_S * dt_s
        goal_m = config.retracted_x_m if away else config.handle_x_m
        if stage != "open":
            self._reference_m += min(step_m, max(-step_m, goal_m - self._reference_m))
        change = dt_s / (_RELAX_NS / NS_PER_S)
        self._firmness = min(1.0, max(0.0, self._firmness + (change if stage == "hold" else -change)))
        torque = {"close": config.grip_torque_n_m, "hold": config.grip_torque_n_m, "relax": config.grip_torque_n_m}
        return Grasp(
            stage,
            torque.get(stage, config.release_torque_n_m),
            self._reference_m,
            config.lift_travel_m if away else config.lift_height_m,
            self._firmness,
        )
