"""Loads a TOML file into the models; an error names the file and the key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from common.config.robots import Config
from common.errors import ConfigError
from common.files.parsing import MOST_DEPTH, UnreadableError, one_line, parse_toml, read_text

M = TypeVar("M", bound=BaseModel)
_MOST_SHOWN = 80
_REMOVED = {"controller.solver": ": controller.method chooses it: davpc, paper_fatrop or paper_ipopt"}


def load_config(path: Path, overrides: Sequence[str] = ()) -> Config:
    """Read the pair's configuration.

    Args:
        path: TOML file.
        overrides: ``table.key=value`` with a TOML value, applied after the file.

    Raises:
        ConfigError: the file is missing or not TOML, a key is unknown, a value out of range.
    """
    try:
        table = parse_toml(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnreadableError as error:
        raise ConfigError(f"{path}: {error}") from error
    for override in overrides:
        _apply(table, override)
    return validate(Config, table, str(path))


def with_overrides(config: Config, overrides: Sequence[str], origin: str) -> Config:
    """A configuration with ``table.key=value`` applied to it.

    Args:
        config: to begin with.
        overrides: with TOML values.
        origin: of the configuration, for errors.

    Raises:
        ConfigError: a key is unknown, a value out of range.
    """
    table = config.model_dump()
    for override in overrides:
        _apply(table, override)
    return validate(Config, table, origin)


def validate(model: type[M], table: Mapping[str, Any], origin: str) -> M:
    """Check a table against its model; an error begins with ``origin``, a file or a file and a table.

    Raises:
        ConfigError: with one line for the first fault, and the number of further ones.
    """
    try:
        return model.model_validate(_tuples(table))
    except ValidationError as error:
        faults = error.errors()
        first = faults[0]
        key = ".".join(str(part) for part in first["loc"]) or "(whole file)"
        what = first["msg"].removeprefix("Value error, ")
        if first["type"] == "extra_forbidden":
            what = "unknown key" + _REMOVED.get(key, "")
        elif first["type"] != "missing" and not isinstance(first["input"], dict | tuple | BaseModel):
            what = f"{what}, got {_short(first['input'])}"
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ConfigError(f"{origin}: {one_line(key)}: {what}{more}") from error


def default_config_path() -> Path:
    """``/etc/davpc/robots.toml`` on a robot, else the reference robots that come with davpc."""
    package = Path(__file__).resolve().parents[1]
    installed = Path("/etc/davpc/robots.toml")
    candidates = [
        installed,
        package.parent / "deploy/config/robots.toml",
        package / "default_config/robots.toml",
    ]
    return next((path for path in candidates if path.exists()), installed)


def _apply(table: dict[str, Any], override: str) -> None:
    key, separator, value = override.partition("=")
    if not separator:
        raise ConfigError(f"override {_short(override)}: write it as table.key=value")
    try:
        given = parse_toml(f"value = {value}")
    except UnreadableError:
        given = {"value": value}
    parsed = given["value"] if given.keys() == {"value"} else value
    *parents, last = parts = key.strip().split(".")
    if not all(parts):
        raise ConfigError(f"override {_short(override)}: write it as table.key=value")
    if len(parents) > MOST_DEPTH:
        raise ConfigError(f"override {_short(override)}: no table is nested that deeply")
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise ConfigError(f"override {_short(override)}: {one_line(parent)} is not a table")
    table[last] = parsed


def _short(value: object) -> str:
    """As a user gave it, cut where it is longer than a line should be."""
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}…"


def _tuples(value: Any) -> Any:
    """TOML arrays as tuples, as the frozen models need them."""
    if isinstance(value, Mapping):
        return {key: _tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    return value
