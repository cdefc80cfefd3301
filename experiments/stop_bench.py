"""The bench of the stop times: bridge and controller as processes, simulated drives with the wheels up, a stop watch.

Estimator, supervisor and arms are played by a feeder that publishes what they would. Every frame on the bus passes
the stop watch. A canary thread notices when the host itself stood still, so that such a trial can be repeated.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from common.bus import Bus
from common.canopen_frames import RPDO, CanFrame
from common.channels import ARM_SETPOINT, DOCKING_STATE, DRIVES, MISSION
from common.config import Config, load_config
from common.executor import earlier_processes
from common.messages import ArmSetpoint, DockingState, Drives, Mission, decode
from common.node import Outbox
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock
from sim.can_bus import SimulatedBus
from sim.can_nodes import FollowerBus
from sim.can_server import CanServer
from sim.drive_402 import PowerState

BRIDGE, CONTROLLER = "follower-can-bridge", "follower-controller"
SPEED_M_S = 0.3
READY_S, UNDER_WAY_S, ARMING_ATTEMPTS = 30.0, 15.0, 5
_PRIORITY = 70
_FEED_PERIOD_NS = NS_PER_S // 120
_CANARY_PERIOD_S = 0.002
_PR_SET_PDEATHSIG = 1
_STOPPED = (PowerState.QUICK_STOP_ACTIVE, PowerState.SWITCH_ON_DISABLED)


class StopWatch(SimulatedBus):
    """A bus that remembers when the wheels were last told to move, first told to stop, and first stopped themselves.

    Times are CLOCK_MONOTONIC [ns], None for what has not happened since :meth:`restart`.
    """

    def __init__(self, robot: FollowerBus) -> None:
        super().__init__(robot.bus.nodes)
        self._wheels = (robot.left_wheel, robot.right_wheel)
        self._ids = {RPDO[0] + wheel.node_id for wheel in self._wheels}
        self.last_rpdo_ns: int | None = None
        self.moving_ns: int | None = None
        self.told_ns: int | None = None
        self.stopped_ns: int | None = None
        self.moved_after_stop = 0

    def restart(self) -> None:
        """Forget what was seen."""
        self.told_ns = self.stopped_ns = self.moving_ns = None
        self.moved_after_stop = 0

    def speed_counts(self) -> int:
        """Smaller of the two wheels' target speeds, in counts per second."""
        return min(abs(wheel.values[0x60FF, 0]) for wheel in self._wheels)

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """Note the frame, then let the nodes have it."""
        answers = super().handle(frame, now_ns)
        if frame.can_id in self._ids and len(frame.data) == 6:
            self._note(frame.data, now_ns)
        self._note_states(now_ns)
        return answers

    def tick(self, now_ns: int) -> list[CanFrame]:
        """Note what the drives do by themselves."""
        sent = super().tick(now_ns)
        self._note_states(now_ns)
        return sent

    def _note(self, data: bytes, now_ns: int) -> None:
        self.last_rpdo_ns = now_ns
        word, velocity = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:], "little")
        if velocity == 0 or word & 0x04 == 0:
            self.told_ns = self.told_ns or now_ns
        else:
            self.moving_ns = now_ns
            self.moved_after_stop += self.told_ns is not None or self.stopped_ns is not None

    def _note_states(self, now_ns: int) -> None:
        if self.stopped_ns is None and all(wheel.state in _STOPPED for wheel in self._wheels):
            self.stopped_ns = now_ns


class Canary:
    """A thread that wants to run every 2 ms: the longest time that it could not is the host's fault."""

    def __init__(self) -> None:
        self._worst_ns = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sing, name="canary", daemon=True)
        self._thread.start()

    def restart(self) -> None:
        """Begin to look anew."""
        self._worst_ns = 0

    def worst_ms(self) -> float:
        """Longest pause beyond the period since then."""
        return self._worst_ns / NS_PER_MS

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _sing(self) -> None:
        before_ns = time.monotonic_ns()
        while not self._stop.wait(_CANARY_PERIOD_S):
            now_ns = time.monotonic_ns()
            self._worst_ns = max(self._worst_ns, now_ns - before_ns - round(_CANARY_PERIOD_S * NS_PER_S))
            before_ns = now_ns


class Feeder:
    """Publishes docking states at 60 Hz, missions at 20 Hz, arm set-points at 120 Hz, except those in ``muted``."""

    def __init__(self, bus: Bus, config: Config) -> None:
        self._bus, self._config = bus, config
        self._clock = MonotonicClock()
        names = ("follower-estimator", "follower-supervisor", "follower-arms")
        self._out = {name: Outbox(name, secrets.randbits(62), self._clock.boot_id) for name in names}
        self.epoch = 0
        self.armed = False
        self.muted: set[str] = set()
        self._beats = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, name="feeder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _feed(self) -> None:
        due_ns = self._clock.now_ns()
        while not self._stop.is_set():
            self._clock.sleep_until(due_ns)
            now_ns = self._clock.now_ns()
            due_ns = max(due_ns + _FEED_PERIOD_NS, now_ns)
            self._beats += 1
            self._send("follower-arms", ARM_SETPOINT, ArmSetpoint(self.epoch, (0.0,) * 6, (0.0, 0.0), 0.2), 1)
            self._send("follower-estimator", DOCKING_STATE, self._state(now_ns), 2)
            self._send("follower-supervisor", MISSION, self._mission(), 6)

    def _send(self, source: str, channel: object, message: object, every: int) -> None:
        if self._beats % every == 0 and source not in self.muted:
            self._bus.publish(channel, self._out[source].pack(channel, message, self._clock.now_ns()))  # type: ignore[arg-type]

    def _state(self, now_ns: int) -> DockingState:
        goal, count = self._config.docking.goal(1), len(self._config.leds.positions_m)
        return DockingState(
            frame_sequence=self._beats,
            capture_ns=now_ns,
            valid=True,
            cause="ok",
            leds_seen=count,
            features=((0.0, 0.0),) * count,
            features_filtered=((0.0, 0.0),) * count,
            theta_homography_rad=None,
            x_m=goal.x_m + 4.0,
            y_m=0.0,
            theta_rad=0.0,
            covariance=(0.0,) * 9,
            disturbance=(0.0,) * 4,
            residual_px=0.0,
            spots=count,
            frames_seen=self._beats,
            frames_dropped=0,
        )

    def _mission(self) -> Mission:
        goal = self._config.docking.goal(1)
        return Mission(
            phase="approach",
            cause="",
            trolley=1,
            method="paper",
            epoch=self.epoch,
            armed=self.armed,
            motion="straight",
            straight_speed_m_s=SPEED_M_S,
            v_max_m_s=SPEED_M_S,
            w_max_rad_s=0.5,
            goal_theta_rad=goal.theta_rad,
            desired_features=(),
            grip="closed",
            push=False,
        )


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
        self._path, self._runtime, self._logs = config_path, runtime, logs
        self._robot = FollowerBus.build(self.config.follower_can, config_path)
        self.watch = StopWatch(self._robot)
        buses = {self.config.follower_can.bus.channel: self.watch}
        self._server = CanServer(self._listener, buses, time.monotonic_ns, before=self._turn_wheels)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._bus = Bus("station", runtime, earlier_processes("station"))
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
        """Start what is not running, arm a new epoch, and wait until both wheels are told to go at 0.3 m/s.

        Raises:
            TimeoutError: it did not come to that.
            RuntimeError: a process died by itself.
        """
        self.feeder.muted.clear()
        self.feeder.armed = False
        for name in (BRIDGE, CONTROLLER):
            child = self._children.get(name)
            if child is None or child.poll() is not None:
                self._children[name] = self._start(name)
        self._await(lambda: {BRIDGE, CONTROLLER} <= self._bus.alive(), READY_S, "bridge and controller are not ready")
        for _ in range(ARMING_ATTEMPTS):
            if self._arm():
                return
        raise TimeoutError(f"{ARMING_ATTEMPTS} times armed and stopped again: see the logs in {self._logs}")

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

        self._await(settled, UNDER_WAY_S, "the wheels are not told to move")
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
        deadline = time.monotonic() + timeout_s
        while not condition():
            dead = [name for name, child in self._children.items() if child.poll() is not None]
            if dead:
                raise RuntimeError(f"{dead[0]} died by itself: see its log in {self._logs}")
            if time.monotonic() > deadline:
                raise TimeoutError(f"{what} after {timeout_s:.0f} s: see the logs in {self._logs}")
            time.sleep(0.01)

    def _start(self, name: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "station.cli", "run", name, "--runtime", str(self._runtime)]
        command += ["--config", str(self._path.resolve())]
        for override in self._overrides:
            command += ["--set", override]
        with (self._logs / f"{name}.log").open("ab") as log:
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                preexec_fn=_die_with_parent,
            )

    def _turn_wheels(self, now_ns: int) -> None:
        """Wheels up: they do what they are told."""
        for wheel in (self._robot.left_wheel, self._robot.right_wheel):
            wheel.advance(now_ns)
            wheel.set_measured(0.0, wheel.velocity_setpoint_rad_s, 0.0)

    @staticmethod
    def _real_time() -> None:
        """Above the processes under test, so that the watch is not late; the canary tells where that is refused."""
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))


def _die_with_parent() -> None:
    """In the child: ordinary scheduling, which it raises itself as on the robot, and no life without its parent."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
