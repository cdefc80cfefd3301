"""Number of locked trolleys, saved so that it outlives a restart of the Leader."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from common.files.parsing import UnreadableError, parse_json, read_text

QUEUE_FILE = "queue.json"
_SCHEMA = "queue/1"
_MOST = 99


@dataclass(frozen=True)
class KeptQueue:
    """Content of the file: the count, None if unknown, and a warning if the operator has to enter it again."""

    count: int | None
    warning: str = ""


def content(count: int | None) -> str:
    """The file's content for a count."""
    return json.dumps({"schema": _SCHEMA, "trolleys": count}) + "\n"


def read(path: Path) -> KeptQueue:
    """Read the count; no file means no trolley, an unreadable file an unknown count."""
    try:
        table = parse_json(read_text(path))
    except FileNotFoundError:
        return KeptQueue(0)
    except (OSError, UnreadableError) as error:
        return KeptQueue(None, f"{path}: cannot be read ({error}): enter the count (davpc lock count N)")
    count = table.get("trolleys", -1) if isinstance(table, dict) and table.get("schema") == _SCHEMA else -1
    if count is None:
        return KeptQueue(None)
    if not isinstance(count, int) or isinstance(count, bool) or not 0 <= count <= _MOST:
        return KeptQueue(None, f"{path}: holds no count of trolleys: enter the count (davpc lock count N)")
    return KeptQueue(count)
