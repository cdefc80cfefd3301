"""The bench of the stop times: bridge and controller as processes, simulated drives with lifted wheels, a watch.

A feeder publishes the messages of estimator, supervisor and arms: controller and bridge are killed here a hundred
times, the others in :mod:`experiments.stop_times.robot`. Every frame on the bus passes the stop watch.
A canary thread notices when the host itself stalled, so that such a trial can be repeated.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from common.bus import Bus
from common.channels import DRIVES
from common.config import load_config
from common.errors import DeviceError
from common.executor import earlier_processes
from common.messages import Drives, decode
from common.timing import NS_PER_S
from experiments.shared.process import Starter, wait_for
from experiments.stop_times.feeder import SPEED_M_S, Feeder
from experiments.stop_times.watch import Canary, StopWatch
from sim.can.nodes import FollowerBus
from sim.can.server import CanServer

BRIDGE, CONTROLLER = "follower-can-bridge", "follower-controller"
READY_S, UNDER_WAY_S, ARMING_ATTEMPTS = 30.0, 15.0, 5
_PRIORITY = 70


class StopBench:
    """Everything of a trial; a context manager that leaves no process behind."""

    def __init__(self, config_path: Path, runtime: Path, logs: Path) -> None:
        self._real_time()
        self._listener = socket.create_server(("127.0.0.1", 0))
        host, port = self._listener.getsockname()[:2]
        self._overrides = [f'follower_can.bus.host="{host}"', f"follower_can.bus.port={port}"]
        self.config = load_config(config_path, self._overrides)
        wheel = self.config.follower_can.left_wheel
        self._counts_per_rad = wheel.counts_per_turn * wheel.gear_ratio / (2 * math.pi)
        self._logs = logs
        self._starter = Starter(config_path, self._overrides, runtime, logs)
        self._robot = FollowerBus.build(self.config.follower_can, config_path)
        self._angles_rad, self._turned_ns = [0.0, 0.0], time.monotonic_ns()
        watch = StopWatch(self._robot)
        self.watch = watch.notes
        buses = {self.config.follower_can.bus.channel: watch}
        self._server = CanServer(self._listener, buses, time.monotonic_ns, before=self._turn_wheels)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._bus = Bus("station", runtime, earlier_processes("station"), self.config.network.namespace)
        self._drives_state = ""
        self._bus.subscribe(DRIVES, self._see_drives)
        self.canary = Canary()
        self.feeder = Feeder(self._bus, self.config)

    def __enter__(self) -> StopBench:
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children.values():
            child.kill()
            child.wait()
        self.feeder.close()
        self.canary.close()
        self._bus.close()
        self._server.stop()

    def get_under_way(self) -> None:
        """Start what is not running, arm a new epoch, and wait until both wheels are commanded 0.3 m/s.

        Raises:
            DeviceError: that state was not reached.
        """
        self.feeder.armed = False
        for name in (BRIDGE, CONTROLLER):
            child = self._children.get(name)
            if child is None or child.poll() is not None:
                self._children[name] = self._starter.start(name)
        self._await(lambda: {BRIDGE, CONTROLLER} <= self._bus.alive(), READY_S, "bridge and controller are not ready")
        for _ in range(ARMING_ATTEMPTS):
            if self._arm():
                return
        raise DeviceError(f"armed and stopped again {ARMING_ATTEMPTS} times: see the logs in {self._logs}")

    def _arm(self) -> bool:
        """One new epoch, as the supervisor begins it; false if the bridge stopped it before it was under way."""
        self.feeder.armed = False
        self.feeder.epoch += 1
        self._drives_state = ""
        self._await(lambda: self._drives_state == "disarmed", READY_S, "the bridge does not get healthy and disarmed")
        self.feeder.armed = True
        wanted = 0.95 * SPEED_M_S / self.config.base.wheel_radius_m * self._counts_per_rad

        def settled() -> bool:
            return self.watch.speed_counts() >= wanted or self._drives_state in ("stopped", "fault")

        self._await(settled, UNDER_WAY_S, "the wheels are not commanded to move")
        return self._drives_state == "armed"

    def _see_drives(self, payload: bytes) -> None:
        self._drives_state = decode(Drives, payload)[1].state

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one of the two processes."""
        os.kill(self._children[name].pid, number)
        if number == signal.SIGKILL:
            self._children[name].wait()

    def pause(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def _await(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        wait_for(condition, timeout_s, what, self._children, self._logs)

    def _turn_wheels(self, now_ns: int) -> None:
        """Wheels lifted: they follow their set-points."""
        passed_s, self._turned_ns = (now_ns - self._turned_ns) / NS_PER_S, now_ns
        for i, wheel in enumerate((self._robot.left_wheel, self._robot.right_wheel)):
            wheel.advance(now_ns)
            self._angles_rad[i] += wheel.velocity_setpoint_rad_s * passed_s
            wheel.set_measured(self._angles_rad[i], wheel.velocity_setpoint_rad_s, 0.0)

    @staticmethod
    def _real_time() -> None:
        """Above the processes under test, so that the watch is not late; the canary shows where that is refused."""
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
