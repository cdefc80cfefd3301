"""The two errors that end a command or a process with one line and an exit code of its own."""

from __future__ import annotations


class ConfigError(Exception):
    """A configuration that cannot be used; the text is one line that names the file and the key."""


class DeviceError(Exception):
    """A device that is missing, refuses or fell silent; one line that names it and what to do."""
