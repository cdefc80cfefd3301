"""Make the reference recordings again, on purpose: ``python -m tests.reference.update``; prints what changed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from common.errors import ConfigError
from common.recording.recording import Recording
from station.replay.compare import judge
from station.report.attempt import RecordedAttempt
from tests.reference.scenarios import CORES, SCENARIOS, stored
from tests.rigs.canbus_rig import CONFIG_PATH


def changes(name: str) -> list[str]:
    """What today's code makes differently of the stored recording."""
    if not stored(name).exists():
        return ["new"]
    lines = []
    try:
        recording = Recording.read(stored(name))
        for core in CORES:
            verdict = judge(core, recording, recording.config, CONFIG_PATH, fresh=True)
            lines += [] if verdict.identical else verdict.summary()
    except ConfigError as error:
        lines.append(str(error))
    return lines


def outcome(path: Path) -> str:
    """Phases and cause of a recorded docking."""
    attempt = RecordedAttempt(Recording.read(path))
    return f"{' → '.join(phase for phase, _, _ in attempt.phases)}; {attempt.cause or 'docked'}"


def main() -> None:
    for name, scenario in SCENARIOS.items():
        found = changes(name)
        if not found:
            print(f"{name}: unchanged")  # noqa: T201 - its purpose
            continue
        before = outcome(stored(name)) if stored(name).exists() else "–"
        with tempfile.TemporaryDirectory() as folder:
            made = scenario.record(Path(folder) / "run.mcap")
            stored(name).write_bytes(made.read_bytes())
        after = outcome(stored(name))
        size_kb = stored(name).stat().st_size // 1000
        print(f"{name} ({size_kb} kB): changed")  # noqa: T201
        for line in (*found, *([f"  was {before}", f"  is  {after}"] if before != after else [])):
            print(f"  {line}")  # noqa: T201


if __name__ == "__main__":
    main()
