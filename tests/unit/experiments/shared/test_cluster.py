"""What a user of ``--cluster`` reads before any run begins; whole clusters are in tests/system."""

from __future__ import annotations

import importlib
import socket

import pytest

from common.errors import ConfigError
from experiments.shared import cluster
from experiments.shared.cluster import cluster_submits, do_here, software


def test_a_missing_extra_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ConfigError, match=r"needs distributed: pip install 'davpc\[cluster\]'"), cluster_submits("x"):
        pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:{port}", "nonsense://x"])
def test_where_no_scheduler_answers_the_address_is_named(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed: pip install 'davpc[cluster]'")
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(ConfigError, match="no scheduler answers there"), cluster_submits(address.format(port=port)):
        pass


def test_a_worker_with_other_software_refuses() -> None:
    assert software() == software()
    with pytest.raises(ConfigError, match="has other software: davpc"):
        do_here(b"", "davpc 0, Python 2")
