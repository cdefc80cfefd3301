"""What an interrupted experiment has done already: files in its results' folder, from which the same call goes on."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

from common.errors import ConfigError
from common.files.writer import replace_file
from experiments.shared.cluster import software

FOLDER = "unfinished"
_log = logging.getLogger("experiment")
Result = TypeVar("Result")


class Unfinished(Generic[Result]):
    """Results of one piece of an experiment, a JSON line each, on disk as soon as there is one.

    Args:
        file: of this piece, see :func:`file_of`.
        kind: a dataclass.
    """

    def __init__(self, file: Path, kind: type[Result]) -> None:
        self.file = file
        self._adapter: TypeAdapter[Result] = TypeAdapter(kind)

    def read(self) -> list[Result]:
        """What was kept, in order. A line that a power cut tore or a hand changed is done again; a warning names it.

        Raises:
            ConfigError: the file cannot be read or mended.
        """
        try:
            data = self.file.read_bytes() if self.file.exists() else b""
            whole, lost = [], 0
            for line in data.split(b"\n"):
                if line.strip():
                    try:
                        whole.append((line, self._adapter.validate_json(line)))
                    except ValidationError:
                        lost += 1
            if lost:
                _log.warning("%s: %d damaged results are left out, their runs done again", self.file, lost)
            if lost or (data and not data.endswith(b"\n")):
                replace_file(self.file, "".join(f"{line.decode()}\n" for line, _ in whole))
        except OSError as error:
            raise ConfigError(f"{self.file}: cannot be used: {error.strerror}: choose another --out") from error
        return [result for _, result in whole]

    def keep(self, results: Iterable[Result]) -> None:
        """Append results.

        Raises:
            ConfigError: they cannot be written.
        """
        lines = [json.dumps(asdict(each), ensure_ascii=False) + "\n" for each in results]  # type: ignore[call-overload] # a dataclass
        try:
            with self.file.open("a", encoding="utf-8") as file:
                file.writelines(lines)
        except OSError as error:
            raise ConfigError(f"{self.file}: cannot be written: {error.strerror}") from error


def file_of(out: Path, name: str, *settings: Any) -> Path:
    """The file of one piece of the work, in a folder made as needed. Other settings, or other software, have another.

    Args:
        out: folder of the experiment's results.
        name: of the piece.
        settings: what its results depend on.
    """
    folder = out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(repr((software(), *settings)).encode()).hexdigest()[:12]
    return folder / f"{name}-{digest}.jsonl"


def finished(files: Iterable[Path]) -> None:
    """Remove the files of an experiment whose results are written; those of another call stay."""
    folders = set()
    for file in files:
        file.unlink(missing_ok=True)
        folders.add(file.parent)
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
