"""``davpc experiment fuzz --live N``: malformed messages through live sockets, into real processes.

They come from a session in the robots' own mesh, where no access list stands before them, and as bytes that are not
even Zenoh on each process's socket, while dockings are under way. No process may end, no wheel pass its ceiling or
turn while disarmed, no memory grow by more than 5 MB; afterwards a docking must succeed. One during the attack may
end, by name: what is malformed replaces newer genuine messages, which then count as stale.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from common.bus import Bus
from common.ceilings import HARD_WHEEL_SPEED_M_S
from common.channels import Channel
from common.config import default_config_path
from common.executor import earlier_processes
from common.messages import MessageError, decode
from common.timing import NS_PER_S, MonotonicClock
from experiments.fuzz.messages import CHANNELS_FUZZED, Mutator
from experiments.fuzz.mutate import spoilt
from experiments.fuzz.watch import MOST_GROWTH_BYTES
from experiments.shared.fleet import Fleet
from experiments.shared.operator import Operator
from experiments.shared.results import missed_note, row, write_results
from experiments.soak.resources import resident_mb
from experiments.stop_times.watch import BusTap
from sim.world_message import WORLD

PER_S = 1000.0
"""Faster, and most would be overwritten by the next before a process reads them."""
_RAW_SHARE = 0.01
_BURST = 20
_REQUEST_S = 0.2
_DOCKING_S, _SETTLE_S, _STOPPED_S = 300.0, 2.0, 1.5
_REPORTS = 10
_SPARE = 1.01  # a set-point is a whole number of encoder counts
_PRIORITY = 70


def run(
    out: Path,
    config_path: Path | None,
    seed: int,
    count: int,
    overrides: Sequence[str],
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Send ``count`` malformed messages; write ``results.json`` and ``table.md``.

    Args:
        out: folder for the results and the logs.
        config_path: TOML file of the pair; None: the reference.
        seed: random seed of the messages.
        count: messages.
        overrides: of the configuration.
        progress: takes a line now and then.
    """
    logs = out / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    with Fleet(config_path or default_config_path(), logs, overrides) as fleet, _bench(fleet) as bench:
        bench.dock("before")
        before = _memory_mb(fleet)
        begin_s = time.monotonic()
        bench.attack(seed, count, progress)
        took_s = time.monotonic() - begin_s
        bench.until(lambda: False, _SETTLE_S)
        bench.until(lambda: not bench.operator.under_way, _DOCKING_S)
        grown = {name: mb - before[name] for name, mb in _memory_mb(fleet).items()}
        refused = {name: fleet.health[name].malformed for name in fleet.children if name in fleet.health}
        bench.dock("after")
        config = fleet.config
    limit_mb = MOST_GROWTH_BYTES / 1e6
    wrong = [*bench.wrong]
    wrong += [f"{name}: memory grew by {mb:.1f} MB" for name, mb in grown.items() if mb > limit_mb]
    if not sum(refused.values()):
        wrong.append("no process counted a malformed message: nothing arrived")
    rows = [
        row(name, "process", count, {"refused": refused.get(name), "growth_mb": mb}) for name, mb in grown.items()
    ]
    settings = {
        "messages": count,
        "per_s": count / took_s,
        "dockings": bench.dockings,
        "fastest_m_s": bench.fastest_m_s(),
        "missed": wrong,
    }
    return write_results(out, "fuzz_live", seed, settings, rows, [], config, missed_note(wrong))


def malformed(seed: int, boot_id: str, now_ns: Callable[[], int]) -> Iterator[tuple[Channel[Any], bytes]]:
    """Payloads without end that none of their channel's readers may take."""
    random = Random(f"live {seed}")
    mutator = Mutator(random, boot_id)
    channels = (*CHANNELS_FUZZED, WORLD)
    while True:
        channel = random.choice(channels)
        payload = mutator.payload(channel, now_ns())
        try:
            decode(channel.message, payload)
        except MessageError:
            yield channel, payload


def _memory_mb(fleet: Fleet) -> dict[str, float]:
    """Of each process that lives."""
    found = {}
    for name, child in fleet.children.items():
        with suppress(OSError, IndexError):
            found[name] = resident_mb(child.pid)
    return found


@contextmanager
def _bench(fleet: Fleet) -> Iterator[_Bench]:
    tap = fleet.tap(_PRIORITY)
    try:
        yield _Bench(fleet, tap)
    finally:
        tap.close()


class _Bench:
    """An operator who goes on docking, whatever is sent, and what must not be seen meanwhile."""

    def __init__(self, fleet: Fleet, tap: BusTap) -> None:
        self._fleet, self._tap = fleet, tap
        self._begin_s = self._armed_s = time.monotonic()
        self.operator = Operator()
        self.dockings: dict[str, Counter[str]] = {}
        self.wrong: list[str] = []

    def dock(self, when: str) -> None:
        """Go on until a docking is done, in three tries at most."""
        operator = self._begin(when)
        over = self.until(lambda: operator.ends["done"] > 0 or bool(operator.given_up), _DOCKING_S)
        if not over or operator.given_up:
            self._note(f"no docking {when} the messages: {operator.given_up or 'none ended'}")

    def attack(self, seed: int, count: int, progress: Callable[[str], None]) -> None:
        """Send to all processes, at a rate at which they read."""
        clock, fleet = MonotonicClock(), self._fleet
        random = Random(f"raw {seed}")
        source = malformed(seed, clock.boot_id, clock.now_ns)
        begin_s = time.monotonic()
        self._begin("during")
        with Bus("stranger", fleet.runtime, earlier_processes("stranger"), fleet.config.network.namespace) as bus:
            for number in range(0, count, _BURST):
                for _ in range(min(_BURST, count - number)):
                    channel, payload = next(source)
                    if random.random() < _RAW_SHARE:
                        _send_raw(fleet.runtime, random, payload)
                    elif channel.kind == "request":
                        bus.request(channel, payload, _REQUEST_S)
                    else:
                        bus.publish(channel, payload)
                self.until(partial(_past, begin_s + number / PER_S), _DOCKING_S)
                if _REPORTS * number // count != _REPORTS * (number + _BURST) // count:
                    ended = dict(self.dockings["during"]) or "none ended"
                    progress(f"fuzz: {number + _BURST} of {count}, dockings: {ended}")
                if self.wrong:
                    return
                if self.operator.given_up:
                    self._begin("during")

    def _begin(self, when: str) -> Operator:
        """From now on another operator, who goes on with the same trolley and has all tries left."""
        trolley = self.operator.trolley
        self.operator = Operator()
        self.operator.trolley, self.operator.ends = trolley, self.dockings.setdefault(when, Counter())
        return self.operator

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Operate and look until the condition holds; whether it did in time."""
        end_s = time.monotonic() + timeout_s
        while True:
            self._step()
            if condition():
                return True
            if time.monotonic() > end_s or self.wrong:
                return False
            time.sleep(0.002)

    def fastest_m_s(self) -> float:
        """Fastest set-point that any wheel got."""
        return self._fleet.wheel_m_s(self._tap.notes.fastest_counts)

    def _step(self) -> None:
        fleet, now_s = self._fleet, time.monotonic()
        fleet.operate(self.operator, now_s - self._begin_s)
        for name, child in fleet.children.items():
            if child.poll() is not None:
                self._note(f"process {name} ended with {child.returncode}: see its log")
        if self.fastest_m_s() > _SPARE * HARD_WHEEL_SPEED_M_S:
            self._note(f"a wheel beyond its ceiling: {self.fastest_m_s():.2f} m/s")
        if fleet.mission is None or fleet.mission.armed:
            self._armed_s = now_s
        moving_ns = self._tap.notes.moving_ns or 0
        if moving_ns > (self._armed_s + _STOPPED_S) * NS_PER_S:
            self._note("the wheels turn while disarmed")

    def _note(self, what: str) -> None:
        if what not in self.wrong:
            self.wrong.append(what)


def _past(due_s: float) -> bool:
    return time.monotonic() >= due_s


def _send_raw(runtime: Path, random: Random, payload: bytes) -> None:
    """Bytes that are not Zenoh, on the socket of some process; it may close it as it likes."""
    head = len(payload).to_bytes(2, "little") if len(payload) < 1 << 16 else b""  # as Zenoh frames its batches
    path = random.choice(sorted(runtime.glob("*.sock")))
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(_REQUEST_S)
        link.connect(str(path))
        link.sendall(spoilt(random, head + payload))
