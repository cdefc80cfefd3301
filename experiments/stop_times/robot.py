"""The whole robot for the stop times: all processes of a simulated run, on the approach to the Leader.

For camera, estimator, supervisor and arms, which a feeder cannot replace: each is killed under way and started again.
Another client of the bus notes the wheels' frames. The robot rolls half a metre per trial; near the Leader everything
is restarted.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

from experiments.shared.fleet import READY_S, Fleet
from experiments.stop_times.watch import Canary

UNDER_WAY_S = 20.0
START_M = (8.0, 0.0, 0.0)
NEAREST_M = 3.2
_UNDER_WAY_M_S = 0.2
_PRIORITY = 70


class StopRobot:
    """Both robots under way; a context manager that leaves no process behind."""

    def __init__(self, config_path: Path, logs: Path) -> None:
        self._path, self._logs = config_path, logs
        self._stack = contextlib.ExitStack()
        self.canary = Canary()

    def __enter__(self) -> StopRobot:
        self._open()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        self.canary.close()

    def get_under_way(self) -> None:
        """Start what is missing, dock again, and wait until the wheels are commanded to move.

        Raises:
            DeviceError: that state was not reached; the text names the logs.
        """
        self._fleet.start_missing()
        world = self._fleet.world
        if world is not None and -world.x_m < NEAREST_M:
            self._stack.close()
            self._open()
        self._fleet.wait(self._fleet.all_alive, READY_S, "not every process is ready")
        self._fleet.wait(self._docking_starts, READY_S, "no docking starts")
        self._fleet.wait(self._rolls, UNDER_WAY_S, "the wheels are not commanded to move")

    def kill(self, name: str) -> None:
        """SIGKILL to one process."""
        self._fleet.children[name].kill()
        self._fleet.children[name].wait()

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def _open(self) -> None:
        """Every process, and the tap."""
        with contextlib.ExitStack() as stack:
            overrides = [f"world.start={list(START_M)}"]
            self._fleet = stack.enter_context(Fleet(self._path, self._logs, overrides))
            self.config = self._fleet.config
            tap = self._fleet.tap(_PRIORITY)
            stack.callback(tap.close)
            self.watch = tap.notes
            self._stack = stack.pop_all()

    def _docking_starts(self) -> bool:
        """Abort and reset, then start a docking; true once the supervisor accepts."""
        self._fleet.ask("abort")
        self._fleet.ask("reset")
        answer = self._fleet.ask("start")
        return answer is not None and answer.outcome == "accepted"

    def _rolls(self) -> bool:
        """Whether both wheels are commanded to move; a docking that ended before is requested again."""
        mission = self._fleet.mission
        if mission is not None and mission.phase == "aborted":
            self._docking_starts()
            self._fleet.mission = None
        armed = mission is not None and mission.armed
        return armed and self._fleet.wheel_m_s(self.watch.speed_counts()) >= _UNDER_WAY_M_S
