"""Those who have no business on the robots' network, and what they would like to do there."""

from __future__ import annotations

import json
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from tests.net.gateways import pki
from tests.rigs.waiting import until


@contextmanager
def connected(endpoint: str, authority: Path, certificate: Path | None, namespace: str) -> Iterator[zenoh.Session]:
    """A session of an attacker, who has no gateway.

    Args:
        endpoint: where to connect to.
        authority: certificate of the authority that he trusts.
        certificate: what he shows, without ``.pem``; None: nothing.
        namespace: put before the keys that he uses.

    Raises:
        zenoh.ZError: he is not let in.
    """
    tls: dict[str, Any] = {"root_ca_certificate": str(authority), "verify_name_on_connect": True}
    if certificate is not None:
        tls |= {"connect_certificate": f"{certificate}.pem", "connect_private_key": f"{certificate}.key"}
        tls |= {"enable_mtls": True}
    settings = {
        "mode": "client",
        "namespace": namespace,
        "connect": {"endpoints": [endpoint], "timeout_ms": 0, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {"open_timeout": 2000},
            "link": {"tls": tls},
        },
    }
    zenoh.init_log_from_env_or("off")
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        yield session


def expired(folder: Path, name: str, target: Path) -> Path:
    """A certificate for ``name`` by the authority in ``folder`` that has just expired; without ``.pem``."""
    target.mkdir()
    for file in ("ca.pem", "ca.key"):
        (target / file).write_bytes((folder / file).read_bytes())
    assert pki(target, "issue", name).returncode == 0
    request = ["openssl", "req", "-new", "-key", str(target / f"{name}.key"), "-subj", f"/CN={name}"]
    made = subprocess.run(request, capture_output=True, check=True).stdout
    sign = ["openssl", "x509", "-req", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "0"]
    sign += ["-extfile", "extensions"]
    (target / "extensions").write_text(f"basicConstraints=CA:false\nsubjectAltName=DNS:{name}\n")
    subprocess.run([*sign, "-out", f"{name}.pem"], input=made, cwd=target, capture_output=True, check=True)
    good = ["openssl", "x509", "-in", str(target / f"{name}.pem"), "-noout", "-checkend", "0"]
    until(lambda: subprocess.run(good, capture_output=True, check=False).returncode == 1, 10)
    return target / name


def first_packets(count: int, authority: Path, certificate: Path) -> list[bytes]:
    """The first datagrams of ``count`` connections, each with an identity of its own."""

    def knock(port: int) -> None:
        try:
            with connected(f"quic/127.0.0.1:{port}", authority, certificate, "davpc"):
                raise AssertionError("no answer there")
        except zenoh.ZError:
            return

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        door.bind(("127.0.0.1", 0))
        door.settimeout(20)
        callers = [threading.Thread(target=knock, args=(door.getsockname()[1],)) for _ in range(count)]
        for caller in callers:
            caller.start()
        packets: dict[Any, bytes] = {}
        while len(packets) < count:
            packet, sender = door.recvfrom(4096)
            packets.setdefault(sender, packet)
        for caller in callers:
            caller.join()
    return list(packets.values())


def resident_mb(pid: int) -> float:
    """Memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6
