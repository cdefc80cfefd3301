"""The unit that a field's name ends with, for headers and descriptions."""

from __future__ import annotations

_UNITS = {
    "_rad_s2": "rad/s²",
    "_m_s2": "m/s²",
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_n_m": "N·m",
    "_deg": "°",
    "_rad": "rad",
    "_mb": "MB",
    "_cm": "cm",
    "_px": "px",
    "_hz": "Hz",
    "_ns": "ns",
    "_us": "µs",
    "_ms": "ms",
    "_m": "m",
    "_s": "s",
    "_n": "N",
    "_a": "A",
    "_v": "V",
}


def unit_of(field: str) -> str:
    """The unit of a field by its name; empty for one without."""
    return next((unit for suffix, unit in _UNITS.items() if field.endswith(suffix)), "")
