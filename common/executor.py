"""A node as a process: config → bus → ready → steps → safe stop, with one way to log, time and count."""

from __future__ import annotations

import gc
import logging
import secrets
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from common.bus import Bus, OnPayload, OnRequest
from common.channels import Channel, health_channel, journal_channel, snapshot_channel
from common.config import load_config
from common.errors import ConfigError, DeviceError
from common.files.parsing import UnreadableError, read_text
from common.files.writer import BackgroundWriter, state_directory
from common.messages import Answer, Health, Message, MessageError
from common.node import Inbox, Node, NodeContext, Outbox
from common.processes import PROCESSES, process
from common.recording import snapshot
from common.recording.journal import JournalWriter, OpenStep
from common.request_desk import RequestDesk
from common.service import be_real_time, notify_service_manager
from common.timing import NS_PER_MS, NS_PER_S, MonotonicClock, Schedule

EXIT_BUG, EXIT_CONFIG, EXIT_DEVICE = 1, 2, 3
REQUEST_TIMEOUT_S = 1.0
_IDLE_S = 0.01
_HEALTH_PERIOD_NS = NS_PER_S // 2
_SNAPSHOT_PERIOD_NS, _SECOND_SNAPSHOT_NS = 8 * NS_PER_S, NS_PER_S


def run_process(name: str, config_path: Path, runtime: Path, overrides: Sequence[str] = ()) -> int:
    """Run one process of the table until SIGTERM or SIGINT.

    Args:
        name: of the process, see :mod:`common.processes`.
        config_path: TOML file of the pair.
        runtime: private directory of sockets, frames and liveness files.
        overrides: ``table.key=value``, applied after the file.

    Returns:
        The exit code: 0, EXIT_CONFIG, EXIT_DEVICE, or EXIT_BUG.
    """
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format=f"%(asctime)s {name} %(levelname)s %(message)s", force=True
    )
    log = logging.getLogger(name)
    clock = MonotonicClock()
    be_real_time(process(name), log)
    try:
        config = load_config(config_path, overrides)
        journal = JournalWriter() if config.recorder.journal and process(name).journaled else None
        run_id = secrets.randbits(62)
        read_clock = clock if journal is None else journal.clock(clock)
        context = NodeContext(config, config_path, runtime, run_id, read_clock, journal)
        node = process(name).factory()(context)
        with ProcessExecutor(node, context, clock, log, journal) as executor:
            return executor.run()
    except ConfigError as error:
        log.error("%s", error)
        return EXIT_CONFIG
    except DeviceError as error:
        log.error("%s", error)
        return EXIT_DEVICE
    except Exception:
        log.exception("stopped by an internal error")
        return EXIT_BUG


def earlier_processes(name: str) -> list[str]:
    """Names before ``name`` in the process table; all of them for a name outside it, such as a station's."""
    names = [candidate.name for candidate in PROCESSES]
    return names[: names.index(name)] if name in names else names


class ProcessExecutor:
    """Runs one node on the bus in real time, as a context manager."""

    def __init__(
        self,
        node: Node,
        context: NodeContext,
        clock: MonotonicClock,
        log: logging.Logger,
        journal: JournalWriter | None = None,
    ) -> None:
        self._node, self._clock, self._log, self._journal = node, clock, log, journal
        self._inbox = Inbox(clock.boot_id, watch=journal)
        self._snapshot_due_ns = 0
        self._outbox = Outbox(node.name, context.run_id, clock.boot_id)
        self._desk = RequestDesk(clock.boot_id, self._packed)
        self._desk_lock = threading.Lock()
        self._wake = threading.Event()
        self._stopping = False
        self._steps = 0
        self._durations_ns: deque[int] = deque(maxlen=1000)
        # its age shows that the loop runs, for health checks that cannot use the bus
        self._alive_file = context.runtime / f"{node.name}.alive"
        kept = state_directory(context.config.state_directory, context.runtime)
        self._seen_file = kept / f"requests-{node.name}.json"
        self._writer = BackgroundWriter(limit=1)
        self._requester = ThreadPoolExecutor(max_workers=2, thread_name_prefix="request")
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        self._bus = Bus(
            node.name,
            context.runtime,
            earlier_processes(node.name),
            context.config.network.namespace,
            node.bus_settings,
        )

    def __enter__(self) -> ProcessExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self._requester.shutdown(wait=False, cancel_futures=True)
        self._writer.close()
        self._bus.close()

    def run(self) -> int:
        """Start the node, step it until :meth:`stop` or a signal, stop it."""
        self._connect()
        try:
            self._node.start(self._clock.now_ns())
            gc.freeze()  # objects made until now are never collected: shorter pauses
            self._bus.declare_alive(self._node.name)
            notify_service_manager("READY=1")
            self._log.info("ready")
            self._loop()
        finally:
            self._publish(self._node.stop(self._clock.now_ns()))
        self._log.info("stopped after %d steps of %.1f ms median, %.1f ms p99", self._steps, *self._step_ms())
        return 0

    def stop(self) -> None:
        """End :meth:`run` after the current step; may be called from any thread."""
        self._stopping = True
        self._wake.set()

    def _connect(self) -> None:
        wakes = {channel.key for channel in self._node.trigger.wakes}
        for channel in self._node.inputs:
            self._bus.subscribe(channel, self._receiver(channel, channel.key in wakes))
        if self._node.overhears:
            self._bus.overhear(lambda key, payload: self._node.overhear(key, payload, self._clock.now_ns()))
        if self._node.serves:
            self._restore_requests()
        for channel in self._node.serves:
            self._bus.serve(channel, self._server(channel))

    def _restore_requests(self) -> None:
        """What was carried out before a restart is not carried out again."""
        try:
            self._desk.restore(read_text(self._seen_file))
        except FileNotFoundError:
            return
        except (OSError, UnreadableError) as error:
            self._log.warning("%s: %s: requests of before this start are not known", self._seen_file, error)

    def _receiver(self, channel: Channel[Any], wakes: bool) -> OnPayload:
        def receive(payload: bytes) -> None:
            self._inbox.put_state(channel, payload, self._clock.now_ns())
            if wakes:
                self._wake.set()

        return receive

    def _server(self, channel: Channel[Any]) -> OnRequest:
        def receive(payload: bytes, reply: Callable[[bytes], None]) -> None:
            try:
                with self._desk_lock:
                    request = self._desk.admit(channel, payload, self._clock.now_ns(), reply)
                    content = self._desk.content() if request is not None else ""
            except MessageError as error:
                self._inbox.refuse(error)
                return
            if request is None:
                return
            self._writer.replace(self._seen_file, content)
            if not self._inbox.put_request(channel, request):
                with self._desk_lock:
                    self._desk.withdraw(request.message.id)
                reply(self._packed(channel, Answer(request.message.id, "refused", "too many requests are waiting")))
            self._wake.set()

        return receive

    def _packed(self, channel: Channel[Any], answer: Answer) -> bytes:
        return self._outbox.pack(channel, answer, self._clock.now_ns())

    def _loop(self) -> None:
        trigger = self._node.trigger
        schedule = Schedule(trigger.period_ns, self._clock.now_ns()) if trigger.period_ns else None
        health_due_ns = 0
        while not self._stopping:
            woken = trigger.free or self._wait(schedule)
            now_ns = self._clock.now_ns()
            due = schedule is not None and now_ns >= schedule.deadline_ns
            if woken or due:
                published = self._step(now_ns)
                if trigger.free and not published:
                    self._wake.wait(_IDLE_S)  # a device that does not block must not spin
            if due and schedule is not None:
                schedule.advance(now_ns)
            if now_ns >= health_due_ns:
                health_due_ns = now_ns + _HEALTH_PERIOD_NS
                self._report(schedule.missed if schedule else 0)

    def _wait(self, schedule: Schedule | None) -> bool:
        deadline_ns = self._clock.now_ns() + _HEALTH_PERIOD_NS
        if schedule is not None:
            deadline_ns = min(deadline_ns, schedule.deadline_ns)
        woken = self._wake.wait(max(0.0, (deadline_ns - self._clock.now_ns()) / NS_PER_S))
        self._wake.clear()
        return woken and not self._stopping

    def _step(self, now_ns: int) -> bool:
        """One step of the node; returns whether it published anything."""
        entry = self._journal.begin(now_ns) if self._journal is not None else None
        self._inbox.begin_step()
        outputs = self._node.step(now_ns, self._inbox)
        if self._journal is not None and entry is not None:
            self._journal.end(entry, len(outputs))
        self._publish(outputs, entry)
        self._steps += 1
        self._durations_ns.append(self._clock.now_ns() - now_ns)
        return bool(outputs)

    def _publish(self, outputs: Sequence[tuple[Channel[Any], Message]], entry: OpenStep | None = None) -> None:
        for channel, message in outputs:
            now_ns = self._clock.now_ns()
            payload = self._outbox.pack(channel, message, now_ns)
            if self._journal is not None and entry is not None:
                self._journal.sent(entry, channel, message, payload, now_ns, self._outbox.sequence(channel))
            if isinstance(message, Answer):
                with self._desk_lock:
                    self._desk.settle(message, payload)
            elif channel.kind == "request":
                self._requester.submit(self._ask, channel, payload)
            else:
                self._bus.publish(channel, payload)

    def _ask(self, channel: Channel[Any], payload: bytes) -> None:
        try:
            reply = self._bus.request(channel, payload, REQUEST_TIMEOUT_S)
        except Exception:  # noqa: BLE001 - logged; the node repeats the request
            self._log.exception("request on %s", channel.key)
            return
        if reply is not None:
            self._inbox.put_answer(channel, reply, self._clock.now_ns())
            self._wake.set()

    def _report(self, missed: int) -> None:
        """Report to the service manager and on the bus that the loop runs, also while no input makes it step."""
        notify_service_manager("WATCHDOG=1")
        while self._inbox.faults:
            self._log.warning("dropped a message: %s", self._inbox.faults.popleft())
        self._alive_file.touch()
        health = Health(
            process=self._node.name,
            ready=True,
            steps=self._steps,
            missed_periods=missed,
            malformed=self._inbox.malformed,
            step_p99_ms=self._step_ms()[1],
        )
        self._publish([(health_channel(self._node.name), health)])
        if self._journal is not None:
            self._publish_journal(self._journal)

    def _publish_journal(self, journal: JournalWriter) -> None:
        """What the steps consumed since the last report; every 8 s the node's state before the next step."""
        name, now_ns = self._node.name, self._clock.now_ns()
        self._publish([(journal_channel(name), batch) for batch in journal.batches()])
        if now_ns >= self._snapshot_due_ns:
            first = self._snapshot_due_ns == 0  # what happens before a recorder is connected is lost
            self._snapshot_due_ns = now_ns + (_SECOND_SNAPSHOT_NS if first else _SNAPSHOT_PERIOD_NS)
            parts = snapshot.take(self._node, self._inbox, journal.steps)
            self._publish([(snapshot_channel(name), part) for part in parts])

    def _step_ms(self) -> tuple[float, float]:
        """Median and 99th percentile of the last steps' durations."""
        durations = sorted(self._durations_ns) or [0]
        last = len(durations) - 1
        return durations[last // 2] / NS_PER_MS, durations[int(0.99 * last)] / NS_PER_MS

    def _on_signal(self, number: int, _frame: object) -> None:
        self._log.info("stopping on %s", signal.Signals(number).name)
        self.stop()
