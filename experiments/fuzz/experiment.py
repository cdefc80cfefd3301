"""``davpc experiment fuzz``: malformed messages, files, overrides and CAN frames; none may raise, move or leak.

The nodes that decide and compute also get anything that their messages' types allow.

Structure-aware: each input begins as a valid one. A finding is an exception that no caller expects, a refusal of
several lines, a set-point beyond a limit, a robot that moves while disarmed, a lock that opens unasked, or memory
that grows by more than 5 MB; its input is kept in ``findings/``. The same seed makes the same inputs at any number of
``workers``.
"""

from __future__ import annotations

import logging
import re
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from common.config import Config, default_config_path, load_config
from common.errors import ConfigError
from experiments.fuzz.can_frames import run_frames
from experiments.fuzz.can_server import run_server
from experiments.fuzz.file_kinds import PROCESS_KINDS
from experiments.fuzz.files import FileKind, length, run_file, run_truncations
from experiments.fuzz.messages import run_messages
from experiments.fuzz.nodes import NODES, run_node
from experiments.fuzz.watch import Crash, Tally, merged
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results

_SHARD = {
    "messages": 50_000,
    "nodes": 10_000,
    "bridge": 20_000,
    "leader": 50_000,
    "server": 10_000,
    "mutations": 1_000,
    "truncations": 1_000,
}
_LEADER_SHARE = _SERVER_SHARE = 0.2
_NODE_SHARE = 0.05  # of the messages, to each node on top

Work = Literal["messages", "nodes", "bridge", "leader", "server", "mutations", "truncations"]


@dataclass(frozen=True, kw_only=True)
class FuzzJob:
    """One shard: ``count`` inputs of one kind of work; of truncations those from byte ``seed`` on."""

    work: Work
    seed: int
    count: int
    config_text: str
    kind: FileKind | None = None
    node: str = ""
    until_s: float | None = None
    stride: int = 1


@dataclass(frozen=True, kw_only=True)
class FuzzPlan:
    """How many inputs: messages, CAN frames, mutations of each kind of file.

    ``seconds`` ends it sooner (0: never); each file is cut at every ``stride``-th byte.
    """

    messages: int
    frames: int
    files: int
    seconds: float = 0.0
    stride: int = 1


def run(
    out: Path, seed: int, workers: Workers, config: Config | None, plan: FuzzPlan, kinds: Sequence[FileKind] = ()
) -> dict[str, Any]:
    """Send everything; write ``results.json``, ``table.md`` and ``findings/``.

    Args:
        out: folder for the results; made if missing.
        seed: random seed.
        workers: who does the runs.
        config: the robots; None: the default configuration.
        plan: how many inputs.
        kinds: of files, besides those that processes read.
    """
    robots = config if config is not None else load_config(default_config_path())
    if plan.seconds and workers.cluster:
        raise ConfigError("--seconds is a time of this machine's clock: not with --cluster")
    todo = _jobs(seed, robots, plan, (*PROCESS_KINDS, *kinds))
    begin_s = time.monotonic()
    done = run_all(fuzz_job, todo, workers, "malformed inputs")
    targets: dict[tuple[str, str], list[Tally]] = {}
    for job, tally in zip(todo, done, strict=True):
        case = "truncated" if job.work == "truncations" else "mutated"
        targets.setdefault((tally.target, case), []).append(tally)
    whole = {key: merged(key[0], parts) for key, parts in targets.items()}
    missed = _keep_findings(out / "findings", whole)
    settings = {
        "plan": {
            "messages": plan.messages,
            "frames": plan.frames,
            "files": plan.files,
            "seconds": plan.seconds,
            "stride": plan.stride,
        },
        "missed": missed,
        "minutes": (time.monotonic() - begin_s) / 60.0,
    }
    rows = [row(target, case, tally.runs, _metrics(tally)) for (target, case), tally in whole.items()]
    left = [f"{target}, {case}" for (target, case), tally in whole.items() if not tally.runs]
    settings["not_reached"] = left
    note = missed_note(missed) + (f"\n\nNot reached in {plan.seconds:g} s: {'; '.join(left)}." if left else "")
    return write_results(out, "fuzz", seed, settings, rows, [], robots, note)


def fuzz_job(job: FuzzJob) -> Tally:
    """One shard; depends on its job alone."""
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)  # a node logs every malformed input
    try:
        return _done(job, _config(job.config_text))
    finally:
        logging.disable(disabled)


def _done(job: FuzzJob, config: Config) -> Tally:
    if job.work == "messages":
        return run_messages(job.seed, job.count, job.until_s)
    if job.work == "nodes":
        return run_node(job.node, config, job.seed, job.count, job.until_s)
    if job.work == "bridge" or job.work == "leader":
        return run_frames(job.work, config, job.seed, job.count, job.until_s)
    if job.work == "server":
        return run_server(config, job.seed, job.count, job.until_s)
    if job.kind is None:
        raise ValueError(f"{job.work}: of which kind of file?")
    if job.work == "mutations":
        return run_file(job.kind, config, job.seed, job.count, job.until_s)
    return run_truncations(job.kind, config, job.seed, job.count, job.until_s, job.stride)


def _jobs(seed: int, config: Config, plan: FuzzPlan, kinds: Sequence[FileKind]) -> list[FuzzJob]:
    text = config.model_dump_json()
    until_s = time.monotonic() + plan.seconds if plan.seconds else None
    leader = round(plan.frames * _LEADER_SHARE)

    def shards(work: Work, count: int, first: int, kind: FileKind | None = None, node: str = "") -> list[FuzzJob]:
        size = _SHARD[work]
        return [
            FuzzJob(
                work=work,
                seed=first + at if work == "truncations" else first * 1_000_003 + at,
                count=min(size, count - at),
                config_text=text,
                kind=kind,
                node=node,
                until_s=until_s,
                stride=plan.stride,
            )
            for at in range(0, count, size)
        ]

    todo = shards("messages", plan.messages, seed)
    for node in NODES:
        todo += shards("nodes", round(plan.messages * _NODE_SHARE), seed, node=node)
    todo += shards("bridge", plan.frames - leader, seed) + shards("leader", leader, seed)
    todo += shards("server", round(plan.frames * _SERVER_SHARE), seed)
    for kind in kinds if plan.files else ():
        todo += shards("mutations", plan.files, seed, kind) + shards("truncations", length(kind, config), 0, kind)
    return todo


@cache
def _config(text: str) -> Config:
    return Config.model_validate_json(text)


def _metrics(tally: Tally) -> dict[str, float | None]:
    counted: Counter[str] = Counter()
    for found in tally.findings.values():
        counted[found.kind] += found.count
    return {
        "taken": tally.taken,
        "refused": tally.refused,
        "exceptions": counted["exception"],
        "limit_breaks": counted["limit"],
        "odd_refusals": counted["refusal"],
        "growth_mb": tally.growth_bytes / 1e6,
        "per_s": tally.runs / tally.seconds if tally.seconds else None,
    }


def _keep_findings(folder: Path, whole: dict[tuple[str, str], Tally]) -> list[str]:
    """Write each finding's input and its text; one line for each."""
    lines: list[str] = []
    for (target, case), tally in whole.items():
        for found in tally.findings.values():
            folder.mkdir(parents=True, exist_ok=True)
            name = re.sub(r"[^a-z0-9]+", "-", f"{target}-{len(lines) + 1}-{found.signature}".lower())[:80]
            (folder / f"{name}.bin").write_bytes(found.data)
            (folder / f"{name}.txt").write_text(found.text + "\n", encoding="utf-8", errors="replace")
            lines.append(_line(target, case, found, name))
    return lines


def _line(target: str, case: str, found: Crash, name: str) -> str:
    return f"{target}, {case}: {found.kind}: {found.signature}, {found.count} times: findings/{name}.bin"
