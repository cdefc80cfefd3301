"""Which recordings go when the disk is to hold no more: oldest first, those of failed dockings last."""

from __future__ import annotations

from pathlib import Path

from common.recording.run import frames_path

_DOCKED = "-docked.mcap"


def superfluous(folder: Path, most_bytes: int) -> list[Path]:
    """The recordings to remove, so that what is left takes at most so many bytes; names begin with their time.

    Raises:
        OSError: the folder cannot be read.
    """
    found = [path for path in folder.glob("*.mcap") if not path.name.endswith(".frames.mcap")]
    sizes = {path: sum(map(_size, (path, frames_path(path)))) for path in found}
    total, remove = sum(sizes.values()), []
    for path in sorted(found, key=lambda path: (not path.name.endswith(_DOCKED), path.name)):
        if total <= most_bytes:
            break
        total -= sizes[path]
        remove.append(path)
    return remove


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
