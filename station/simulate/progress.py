"""Live progress of a docking in the terminal; plain lines where there is no terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.table import Table

from common.timing import NS_PER_MS, NS_PER_S
from station.operate.format import place
from station.simulate.record import DockingRecord
from station.simulate.run import Progress


@contextmanager
def live_progress(console: Console) -> Iterator[Progress]:
    """A function that shows the record each time it is called."""
    if console.is_terminal:
        with Live(console=console, refresh_per_second=8, transient=True) as live:
            yield lambda record: live.update(_table(record))
    else:
        shown: list[tuple[int, str]] = []

        def show(record: DockingRecord) -> None:
            if record.phases and (record.trolley, record.phases[-1][0]) not in shown:
                shown.append((record.trolley, record.phases[-1][0]))
                waiting = f"  waits for {record.mission.waiting}" if record.mission and record.mission.waiting else ""
                line = f"{_seconds(record):6.1f} s  {record.trolley}  {record.phases[-1][0]:10s} {_where(record)}"
                console.print(line + waiting, soft_wrap=True)

        yield show


def _table(record: DockingRecord) -> Table:
    table = Table.grid(padding=(0, 2))
    state, drives, leader = record.states[-1] if record.states else None, record.drives, record.leader
    waiting = f"  waits for {record.mission.waiting}" if record.mission and record.mission.waiting else ""
    table.add_row("[bold]phase", f"[bold cyan]{record.phase}[/]  {_seconds(record):.1f} s{waiting}")
    table.add_row("trolley", str(record.trolley))
    table.add_row("pose", _where(record))
    if state is not None:
        age_ms = (record.newest_stamp_ns - state.capture_ns) / 1e6
        table.add_row(
            "LEDs", f"{state.leds_seen} seen, {state.cause}, frame {state.frame_sequence}, age {age_ms:.0f} ms"
        )
    if drives is not None:
        commanded = f"v {drives.v_set_m_s:+.3f} m/s  ω {drives.w_set_rad_s:+.3f} rad/s"
        table.add_row("drives", f"{drives.state}  {commanded}  image→CAN {drives.image_to_can_ns / 1e6:.1f} ms")
    if record.arms is not None:
        table.add_row(
            "arms", f"handle {record.arms.handle_force_n:+.1f} N{'  contact' if record.arms.contact else ''}"
        )
    ages = [
        f"{channel.key.rsplit('/', 1)[-1]} {(record.newest_stamp_ns - record.stamps_ns[channel.key]) / NS_PER_MS:.0f}"
        for channel in DockingRecord.CHANNELS
        if channel.key in record.stamps_ns
    ]
    table.add_row("ages, ms", "  ".join(ages))
    if leader is not None:
        table.add_row("Leader", f"guide {leader.guide}, lock {leader.lock}")
    return table


def _where(record: DockingRecord) -> str:
    return place(record.states[-1] if record.states else None, record.goal())


def _seconds(record: DockingRecord) -> float:
    start_ns = record.phase_start_ns("acquire")
    return (record.newest_stamp_ns - start_ns) / NS_PER_S if start_ns is not None else 0.0
