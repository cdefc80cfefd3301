"""The modules that decide about motion, with the tests that must notice a change of each.

Of the supervisor all but its reports on disk (``attempt_report.py``, ``journal.py``), which decide nothing.
"""

from __future__ import annotations

from typing import Final

_BRIDGE: Final = "tests/unit/follower/can_bridge/test_"
_SUPERVISOR: Final = "tests/unit/follower/supervisor/test_"
_GATE: Final = tuple(f"{_BRIDGE}gate{part}.py" for part in ("", "_caps", "_wheels", "_window", "_encoders"))
_PHASES: Final = "tests/unit/follower/supervisor/phases/test_"
_SEQUENCE: Final = (
    *(f"{_SUPERVISOR}sequence{part}.py" for part in ("", "_contact", "_guards", "_pauses", "_stops")),
    *(
        f"{_PHASES}{phase}.py"
        for phase in ("approach", "approach_ends", "contact", "lock", "acquire", "staging", "staging_limits")
    ),
    f"{_SUPERVISOR}attempt.py",
)
TARGETS: Final[dict[str, tuple[str, ...]]] = {
    "common/ceilings.py": ("tests/unit/common/test_ceilings.py",),
    "follower/can_bridge/gate.py": _GATE,
    "follower/can_bridge/wheel_tracking.py": (f"{_BRIDGE}wheel_tracking.py",),
    "follower/can_bridge/angle_watch.py": (f"{_BRIDGE}angle_watch.py", f"{_BRIDGE}angle_watch_limits.py"),
    "follower/model/taught.py": ("tests/unit/follower/model/test_taught.py",),
    **{
        f"follower/supervisor/{name}.py": tests
        for name, tests in {
            "attempt": _SEQUENCE,
            "image_trust": (f"{_SUPERVISOR}image_trust.py", *_SEQUENCE),
            "fitness": (f"{_SUPERVISOR}fitness.py",),
            "interface": _SEQUENCE,
            "late_watch": (f"{_SUPERVISOR}late_watch.py",),
            "lateral_forecast": (f"{_SUPERVISOR}lateral_forecast.py",),
            "manual": (f"{_SUPERVISOR}manual.py",),
            "node": (f"{_SUPERVISOR}node.py", f"{_SUPERVISOR}node_outputs.py"),
            "run_watch": (f"{_SUPERVISOR}run_watch.py",),
            "sequence": _SEQUENCE,
            "transitions": (*_SEQUENCE, "tests/repository/test_tables.py"),
            **{
                f"phases/{phase}": _SEQUENCE
                for phase in ("acquire", "approach", "contact", "lock", "phase", "staging")
            },
        }.items()
    },
}
