"""The configuration of the reference robots."""

from __future__ import annotations

from pathlib import Path

REFERENCE = Path(__file__).parents[2] / "deploy/config/robots.toml"
