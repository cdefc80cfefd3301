"""Malformed CAN frames into the Follower's bridge and the Leader's module, each a whole node on a simulated bus."""

from __future__ import annotations

import struct
import tempfile
from functools import partial
from pathlib import Path
from random import Random
from typing import Literal

from common.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, CanFrame
from common.config import Config
from experiments.fuzz.bridge_bench import BridgeBench
from experiments.fuzz.leader_bench import LeaderBench
from experiments.fuzz.watch import BoundedCall, Tally

Target = Literal["bridge", "leader"]
_STATUS_WORDS = (0x0227, 0x0207, 0x0208, 0x0240, 0x1237, 0x020F)
_POSITIONS = (0, 10**5, -(10**5), 2**31 - 1, -(2**31))
_ERRORS = (0x000, 0x001, 0x004, 0x020, 0x100)
_BUS_OFF_SHARE = 2e-4
_MOST_DATA = 64  # bytes of a CAN FD frame


def mutated_frame(random: Random, genuine: CanFrame) -> CanFrame:
    """A genuine frame with one part changed, or one that CANopen does not use."""
    can_id, data = genuine.can_id, bytearray(genuine.data)
    match random.randrange(12):
        case 0 | 1 if data:
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        case 2:
            data = data[: random.randrange(9)]
        case 3:
            data = bytearray((*data, *random.randbytes(8)))[: random.randrange(9)]
        case 4:
            can_id ^= 1 << random.randrange(11)
        case 5:
            can_id = random.randrange(0x800)
        case 6:
            data = bytearray(random.randbytes(random.randrange(9)))
        case 7:
            word = random.choice((*_STATUS_WORDS, random.randrange(0x10000)))
            data = bytearray(struct.pack("<Hih", word, random.choice(_POSITIONS), random.randrange(-0x8000, 0x8000)))
        case 8:
            can_id = EXTENDED_FLAG | can_id | random.randrange(2**18) << 11
        case 9:
            can_id |= REMOTE_FLAG
        case 10:
            off = random.random() < _BUS_OFF_SHARE
            can_id, data = ERROR_FLAG | (0x40 if off else random.choice(_ERRORS)), bytearray(8)
        case _:
            data = bytearray(random.randbytes(random.choice((12, 16, _MOST_DATA))))
    return CanFrame(can_id, bytes(data))


def run_frames(target: Target, config: Config, seed: int, count: int, until_s: float | None) -> Tally:
    """Send frames to a node: nothing beyond a limit leaves the bridge, the Leader opens nothing unasked.

    Args:
        target: ``bridge`` or ``leader``.
        config: the robots.
        seed: random seed.
        count: frames; what passes between them does not count.
        until_s: time.monotonic() after which nothing more is sent; None: no such time.
    """
    make: type[BridgeBench | LeaderBench] = BridgeBench if target == "bridge" else LeaderBench
    random = Random(f"{target} {seed}")
    watch = BoundedCall(target, count, until_s)
    with tempfile.TemporaryDirectory(prefix="davpc-fuzz-") as folder, make(config, random, Path(folder)) as bench:
        while watch.goes_on:
            frames = [mutated_frame(random, random.choice(bench.genuine)) for _ in range(_burst(random, bench.ready))]
            data = b"".join(struct.pack("<IB", frame.can_id, len(frame.data)) + frame.data for frame in frames)
            watch.attempt(data, partial(bench.step, frames), runs=len(frames))
    return watch.finish()


def _burst(random: Random, ready: bool) -> int:
    """While the robot works single frames, then many, up to more than a receive buffer holds; else few."""
    shares = (0.8, 0.17, 0.029, 0.001) if ready else (0.99, 0.008, 0.002, 0.0)
    return random.choices((0, 1, random.randrange(2, 400), 5000), shares)[0]
