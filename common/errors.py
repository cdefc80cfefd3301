"""The two errors that end a command or a process with one line and their own exit code."""

from __future__ import annotations


class ConfigError(Exception):
    """The configuration cannot be used; one line that names the file and the key."""


class DeviceError(Exception):
    """A device is missing, refuses or fell silent; one line that names it and what to do."""
