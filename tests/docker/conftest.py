"""A container engine of the tests' own, with the image."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docker.engine import BASE, IMAGE, Engine, base_tar, context, missing


@pytest.fixture(scope="session")
def engine() -> Iterator[Engine]:
    """An engine that has the image; gone, with all it held, at the end."""
    why = missing()
    if why:
        pytest.skip(why)
    folder = Path(tempfile.mkdtemp(prefix="davpc-docker-"))
    try:
        engine = Engine(folder)
        try:
            engine.docker("import", str(base_tar()), BASE)
            arguments = ["--build-arg", f"BASE_IMAGE={BASE}", "--build-arg", "PIP_NO_INDEX=1", "--network", "none"]
            built = context(folder / "context")
            engine.docker("build", "-t", IMAGE, "-f", str(built / "docker/Dockerfile"), *arguments, str(built))
            yield engine
        finally:
            engine.stop()
        mounted = [line for line in Path("/proc/self/mounts").read_text().splitlines() if str(folder) in line]
        assert mounted == []
    finally:
        shutil.rmtree(folder)
