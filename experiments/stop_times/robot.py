"""The whole robot for the stop times: all processes of a simulated run, on the approach to the Leader.

For camera, estimator, supervisor and arms, which a feeder cannot replace: each is killed under way and started again.
Another client of the bus notes the wheels' frames. The robot rolls half a metre per trial; near the Leader everything
is restarted.
"""

from __future__ import annotations

import contextlib
import math
import secrets
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from common.bus import Bus
from common.channels import DOCK_REQUEST, MISSION
from common.config import BusConfig, load_config
from common.executor import earlier_processes
from common.messages import Answer, DockRequest, Mission, decode
from common.node import Outbox
from common.processes import ONE_MACHINE
from common.timing import NS_PER_S, MonotonicClock
from experiments.stop_times.process import Starter, wait_for
from experiments.stop_times.watch import BusTap, Canary
from sim.world_message import WORLD, WorldState

READY_S, UNDER_WAY_S = 40.0, 20.0
START_M = (8.0, 0.0, 0.0)
NEAREST_M = 3.2
_UNDER_WAY_M_S = 0.2
_PRIORITY = 70
_STATION = "station"
_MEMORY = Path("/dev/shm")


class StopRobot:
    """Both robots under way; a context manager that leaves no process behind."""

    def __init__(self, config_path: Path, logs: Path) -> None:
        self._path, self._logs = config_path, logs
        self._stack = contextlib.ExitStack()
        self._clock = MonotonicClock()
        self.canary = Canary()
        self._children: dict[str, subprocess.Popen[bytes]] = {}

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
        for name, child in self._children.items():
            if child.poll() is not None:
                self._children[name] = self._starter.start(name)
        if -self._x_m < NEAREST_M:
            self._stack.close()
            self._open()
        self._await(self._all_alive, READY_S, "not every process is ready")
        self._await(self._docking_starts, READY_S, "no docking starts")
        self._await(self._rolls, UNDER_WAY_S, "the wheels are not commanded to move")

    def kill(self, name: str) -> None:
        """SIGKILL to one process."""
        self._children[name].kill()
        self._children[name].wait()

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def _open(self) -> None:
        """Every process, the tap and the station's bus."""
        with contextlib.ExitStack() as stack:
            folder = tempfile.TemporaryDirectory(prefix="davpc-", dir=_MEMORY if _MEMORY.is_dir() else None)
            runtime = Path(stack.enter_context(folder))
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            host, port = server.getsockname()
            buses = [f"{robot}_can.bus" for robot in ("follower", "leader")]
            overrides = [f'{bus}.host="{host}"' for bus in buses] + [f"{bus}.port={port}" for bus in buses]
            overrides += [f"world.can_server_fd={server.fileno()}", f"world.start={list(START_M)}"]
            self.config = load_config(self._path, overrides)
            self._starter = Starter(self._path, overrides, runtime, self._logs, (server.fileno(),))
            self._x_m, self._phase, self._armed = -START_M[0], "", False
            stack.callback(self._kill_all)
            for entry in ONE_MACHINE:
                self._children[entry.name] = self._starter.start(entry.name)
            namespace = self.config.network.namespace
            self._bus = stack.enter_context(Bus(_STATION, runtime, earlier_processes(_STATION), namespace))
            self._outbox = Outbox(_STATION, secrets.randbits(62), self._clock.boot_id)
            self._bus.subscribe(WORLD, self._see_world)
            self._bus.subscribe(MISSION, self._see_mission)
            self._await(self._all_alive, READY_S, "not every process is ready")
            can = self.config.follower_can
            bus = BusConfig(interface="socketcand", channel=can.bus.channel, host=host, port=port)
            tap = BusTap(bus, (can.left_wheel.node_id, can.right_wheel.node_id), _PRIORITY)
            stack.callback(tap.close)
            self.watch = tap.notes
            self._stack = stack.pop_all()

    def _kill_all(self) -> None:
        for child in self._children.values():
            child.kill()
            child.wait()
        self._children.clear()

    def _all_alive(self) -> bool:
        return self._bus.alive() >= set(self._children)

    def _docking_starts(self) -> bool:
        """Abort and reset, then start a docking; true once the supervisor accepts."""
        actions: tuple[Literal["abort", "reset", "start"], ...] = ("abort", "reset", "start")
        for action in actions:
            now_ns = self._clock.now_ns()
            request = DockRequest(f"stop-{secrets.token_hex(4)}", now_ns + 2 * NS_PER_S, action)
            reply = self._bus.request(DOCK_REQUEST, self._outbox.pack(DOCK_REQUEST, request, now_ns), 1.0)
            outcome = decode(Answer, reply)[1].outcome if reply is not None else ""
        return outcome == "accepted"

    def _rolls(self) -> bool:
        """Whether both wheels are commanded to move; a docking that ended before is requested again."""
        if self._phase == "aborted":
            self._docking_starts()
            self._phase = ""
        wheel = self.config.follower_can.left_wheel
        counts_per_m = wheel.counts_per_turn * wheel.gear_ratio / (2 * math.pi) / self.config.base.wheel_radius_m
        return self._armed and self.watch.speed_counts() >= _UNDER_WAY_M_S * counts_per_m

    def _see_world(self, payload: bytes) -> None:
        self._x_m = decode(WorldState, payload)[1].x_m

    def _see_mission(self, payload: bytes) -> None:
        mission = decode(Mission, payload)[1]
        self._phase, self._armed = mission.phase, mission.armed

    def _await(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        wait_for(condition, timeout_s, what, self._children, self._logs)
