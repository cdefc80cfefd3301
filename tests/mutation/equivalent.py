"""Mutants without an observable effect, by module, function and change, each with its reason."""

from __future__ import annotations

from typing import Final

_LAST_BITS: Final = "differs in the last bits of a set-point only"
_WITHIN_TOLERANCE: Final = "one millisecond of lag is 0.6 mm at the highest speed, less than GAP_M"
EQUIVALENT: Final[dict[tuple[str, str, str], str]] = {
    ("follower/can_bridge/gate.py", "", "1e-09  →  1.02e-09"): _LAST_BITS,
    (
        "follower/can_bridge/gate.py",
        "Gate._limit",
        "min(scale, lowered) < 1.0 - ROUNDING  →  min(scale, lowered) <= 1.0 - ROUNDING",
    ): _LAST_BITS,
    ("follower/can_bridge/angle_watch.py", "", "0  →  1"): _WITHIN_TOLERANCE,
    ("follower/can_bridge/angle_watch.py", "", "20  →  21"): _WITHIN_TOLERANCE,
    ("follower/can_bridge/angle_watch.py", "", "40  →  41"): _WITHIN_TOLERANCE,
}
