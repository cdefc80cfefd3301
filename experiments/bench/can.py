"""``davpc bench can``: what the bridge's bus costs at 100 Hz with twelve nodes, against simulated nodes or real ones.

``run`` writes ``results.json``: SDO round trip, duration of one exchange, lateness of the loop [ms] and the bridge
side's share of a core [%]. The drives are never enabled.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import socket
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from common.canopen.bus import CanBus
from common.canopen.node import CanopenNode, find_eds
from common.config import BusConfig, Config, default_config_path, load_config
from common.files.writer import write_json
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock, Schedule
from experiments.shared.results import configuration
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import DriveSetpoint
from sim.can.nodes import FollowerBus
from sim.can.server import CanServer

RATE_HZ = 100
ROUND_TRIPS = 500


def run(out: Path, config_path: Path | None = None, real_bus: bool = False, cycles: int = 2000) -> dict[str, Any]:
    """Measure.

    Args:
        out: folder for the results; made if missing.
        config_path: the robots; None: the default configuration.
        real_bus: use the bus of the configuration instead of simulated nodes in a process of their own.
        cycles: of 10 ms.

    Raises:
        DeviceError: a bus or node is missing.
    """
    path = config_path or default_config_path()
    config = load_config(path)
    with contextlib.ExitStack() as stack:
        bus = config.follower_can.bus if real_bus else stack.enter_context(_simulated_nodes(path))
        rows = [_row("sdo_round_trip", _round_trips(config, bus, path)), *_loop(config, bus, path, cycles)]
    results = {
        "experiment": "bench_can",
        "settings": configuration(config),
        "bus": f"{bus.interface} {bus.channel}",
        "rows": rows,
    }
    out.mkdir(parents=True, exist_ok=True)
    return write_json(out / "results.json", results)


def _round_trips(config: Config, bus_config: BusConfig, path: Path) -> list[int]:
    """Durations of SDO reads of the left wheel's statusword [ns]."""
    can = config.follower_can
    bus = CanBus(bus_config)
    try:
        node = CanopenNode(bus, can.left_wheel.node_id, "left wheel", find_eds(can.drive_eds, path))
        durations = []
        for _ in range(ROUND_TRIPS):
            before_ns = time.monotonic_ns()
            node.read(0x6041)
            durations.append(time.monotonic_ns() - before_ns)
        return durations
    finally:
        bus.close()


def _loop(config: Config, bus: BusConfig, path: Path, cycles: int) -> list[dict[str, Any]]:
    """The bridge's loop on its absolute schedule."""
    drives = DriveBus(config.follower_can.model_copy(update={"bus": bus}), config.base, path)
    clock = MonotonicClock()
    exchange_ns, late_ns = [], []
    drives.open()
    try:
        schedule = Schedule(NS_PER_S // RATE_HZ, clock.now_ns())
        start_ns, start_cpu_ns = clock.now_ns(), time.process_time_ns()
        for _ in range(cycles):
            clock.sleep_until(schedule.deadline_ns)
            now_ns = clock.now_ns()
            late_ns.append(now_ns - schedule.deadline_ns)
            measured = drives.exchange(now_ns, DriveSetpoint())
            exchange_ns.append(clock.now_ns() - now_ns)
            schedule.advance(now_ns)
        share = (time.process_time_ns() - start_cpu_ns) / (clock.now_ns() - start_ns)
    finally:
        drives.close()
    load = {
        "method": "bridge_cpu",
        "metrics": {"percent": 100.0 * share, "missed_periods": schedule.missed, "malformed": measured.malformed},
    }
    return [_row("exchange", exchange_ns), _row("lateness", late_ns), load]


def _row(method: str, durations_ns: list[int]) -> dict[str, Any]:
    ordered = sorted(durations_ns)
    p50, p99 = ordered[len(ordered) // 2], ordered[len(ordered) * 99 // 100]
    return {"method": method, "n": len(ordered), "metrics": {"p50_ms": p50 / NS_PER_MS, "p99_ms": p99 / NS_PER_MS}}


@contextlib.contextmanager
def _simulated_nodes(path: Path) -> Iterator[BusConfig]:
    """The Follower's nodes in a process of their own, so that the bridge's side is measured alone."""
    ours, theirs = multiprocessing.Pipe()
    child = multiprocessing.get_context("spawn").Process(target=_serve, args=(theirs, path), daemon=True)
    child.start()
    host, port = ours.recv()
    try:
        yield BusConfig(interface="socketcand", channel="follower", host=host, port=port)
    finally:
        ours.send(None)
        child.join()


def _serve(link: Connection, path: Path) -> None:
    robot = FollowerBus.build(load_config(path).follower_can, path)
    server = CanServer(socket.create_server(("127.0.0.1", 0)), {"follower": robot.bus}, time.monotonic_ns)
    server.start()
    link.send(server.address)
    link.recv()
    server.stop()
