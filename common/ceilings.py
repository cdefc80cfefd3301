"""Hard ceilings of motion: constants in code that configuration and mission can only lower (docs/safety.md, layer 2).

Each stands here once: the gate enforces it, the bounds of the configuration and the doctor's check derive from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from common.messages import Phase

HARD_V_MAX_M_S: Final = 0.6
HARD_V_MIN_M_S: Final = -0.2
HARD_W_MAX_RAD_S: Final = 0.8
HARD_WHEEL_SPEED_M_S: Final = 0.6
"""Surface speed of either wheel; also the speed limit in the wheel drives (607Fh)."""
HARD_ACCELERATION_M_S2: Final = 0.6
HARD_ANGULAR_ACCELERATION_RAD_S2: Final = 2.5

HARD_JOINT_TORQUE_N_M: Final = 25.0
HARD_GRIP_TORQUE_N_M: Final = 6.0
HARD_LIFT_M: Final = 1.0


@dataclass(frozen=True, kw_only=True)
class PhaseCap:
    """The fastest that a phase may drive: speed and turning rate of {F}, surface speed of either wheel."""

    v_m_s: float
    w_rad_s: float
    wheel_m_s: float


STILL: Final = PhaseCap(v_m_s=0.0, w_rad_s=0.0, wheel_m_s=0.0)
_SLOW: Final = PhaseCap(v_m_s=0.10, w_rad_s=0.30, wheel_m_s=0.15)
_CONTACT: Final = PhaseCap(v_m_s=0.05, w_rad_s=0.20, wheel_m_s=0.08)
PHASE_CAPS: Final[dict[Phase, PhaseCap]] = {
    "idle": STILL,
    "staging": _SLOW,
    "search": PhaseCap(v_m_s=0.0, w_rad_s=0.30, wheel_m_s=0.08),
    "acquire": _SLOW,
    "approach": PhaseCap(v_m_s=HARD_V_MAX_M_S, w_rad_s=HARD_W_MAX_RAD_S, wheel_m_s=HARD_WHEEL_SPEED_M_S),
    "insert": _CONTACT,
    "push": _CONTACT,
    "lock": PhaseCap(v_m_s=0.05, w_rad_s=0.10, wheel_m_s=0.06),
    "release": STILL,
    "retract": _SLOW,
    "manual": _SLOW,
    "done": STILL,
    "aborted": STILL,
}
