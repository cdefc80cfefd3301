"""The methods at pixel level: the default one as on the robot, the others on what perception measures."""

from __future__ import annotations

import numpy as np

from common.messages import Mission
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.pilots import PilotFactory
from experiments.feature_level.pixels.world import PerceivedFrame
from experiments.feature_level.task import Insight, Pilot, Task, Twist
from follower.controller.davpc import DavpcMethod
from follower.controller.docking import DockingController
from follower.controller.interface import PoseController


class RuntimePilot:
    """The controller process's own code, with a mission that caps nothing."""

    def __init__(self, task: Task, controller: PoseController) -> None:
        self.insight = Insight()
        controller.reset()
        self._docking = DockingController(task.config, DavpcMethod(task.config, controller))
        self._mission = _uncapped(task)
        self._seen: PerceivedFrame | None = None

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Keep the newest docking state."""
        assert isinstance(measurement, PerceivedFrame)
        self._seen = measurement

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """From the newest docking state, for ``base.latency_ms`` after its exposure."""
        assert self._seen is not None
        state = self._seen.state
        twist = self._docking.step(state.capture_ns, state, self._mission, wheels)
        self._docking.commit(twist)
        self.insight.disturbance = np.array(state.disturbance)
        self.insight.solves += state.valid
        self.insight.failures += state.valid and twist.source != "solved"
        return twist.v_m_s, twist.w_rad_s


class WaitingPilot:
    """A method of the feature level that stands still until perception has seen the array once."""

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self.insight = pilot.insight
        self._started = False

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        """Hand the frame on, from the first that shows the whole array."""
        self._started = self._started or bool(np.isfinite(measurement.features).all())
        if self._started:
            self._pilot.see(measurement, wheels, applied)

    def command(self, wheels: Twist, applied: Twist) -> Twist:
        """The method's command."""
        return self._pilot.command(wheels, applied) if self._started else (0.0, 0.0)


class PixelPilotFactory(PilotFactory):
    """Makes a method's pilots for the pixel level."""

    def make(self) -> Pilot:
        """A pilot for one run."""
        if self._own is not None:
            return RuntimePilot(self.task, self._own)
        return WaitingPilot(super().make())


def _uncapped(task: Task) -> Mission:
    limits = task.config.limits
    return Mission(
        phase="approach",
        cause="",
        trolley=1,
        epoch=1,
        armed=True,
        motion="servo",
        straight_speed_m_s=0.0,
        v_max_m_s=limits.v_max_m_s,
        w_max_rad_s=limits.w_max_rad_s,
        goal_theta_rad=task.goal_leader_in_follower.theta_rad,
        desired_features=tuple((float(a), float(b)) for a, b in task.desired),
        grip="closed",
        contact_expected=False,
        resets=0,
    )
