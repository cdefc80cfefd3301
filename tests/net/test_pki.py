"""``deploy/pki.sh``: an authority, certificates by name, renewal, and word before they expire."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from common.errors import ConfigError
from gateway.credentials import check_credentials
from tests.net.gateways import authority, needs_openssl, pki

pytestmark = needs_openssl


def shown(certificate: Path, *what: str) -> str:
    """What openssl shows of a certificate."""
    command = ["openssl", "x509", "-in", str(certificate), "-noout", *what]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_a_certificate_is_the_authoritys_for_its_name_and_hosts_both_ways(tmp_path: Path) -> None:
    folder = authority(tmp_path / "pki")
    hosts = ("--host", "10.77.0.1", "--host", "robot.example", "--host", "fd00::1")
    assert pki(folder, "issue", "follower", *hosts).returncode == 0
    verify = ["openssl", "verify", "-x509_strict", "-CAfile", str(folder / "ca.pem")]
    for purpose in ("sslserver", "sslclient"):
        subprocess.run([*verify, "-purpose", purpose, str(folder / "follower.pem")], check=True, capture_output=True)
    names = shown(folder / "follower.pem", "-subject", "-ext", "subjectAltName")
    for name in ("CN = follower", "DNS:follower", "10.77.0.1", "DNS:robot.example", "FD00:0:0:0:0:0:0:1"):
        assert name in names
    assert all(file.stat().st_mode & 0o077 == 0 for file in folder.iterdir())


def test_renewal_keeps_key_and_hosts_and_the_predecessor(tmp_path: Path) -> None:
    folder = authority(tmp_path / "pki", "leader")
    before = (folder / "leader.pem").read_bytes()
    parts = ("-pubkey", "-subject", "-ext", "subjectAltName")
    first = shown(folder / "leader.pem", *parts)
    assert pki(folder, "renew", "leader", "--days", "700").returncode == 0
    assert shown(folder / "leader.pem", *parts) == first
    assert (folder / "leader.pem").read_bytes() != before
    assert (folder / "leader.pem.old").read_bytes() == before
    assert "will not expire" in shown(folder / "leader.pem", "-checkend", str(699 * 86_400))


def test_expiry_says_what_expires_within_the_time(tmp_path: Path) -> None:
    folder = authority(tmp_path / "pki", "follower")
    assert pki(folder, "expiry").returncode == 0
    assert pki(folder, "issue", "leader", "--days", "20").returncode == 0
    printed = pki(folder, "expiry")
    assert printed.returncode == 1
    assert [line.split()[:2] for line in printed.stdout.splitlines()] == [
        ["ok", "ca"],
        ["ok", "follower"],
        ["renew", "leader"],
    ]
    assert pki(folder, "expiry", "--warn-days", "10").returncode == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("ca",), "ca.pem exists"),
        (("issue", "leader"), "leader.pem exists"),
        (("renew", "follower"), "follower.pem: cannot be read; make it first: pki.sh issue follower"),
        (("issue", "ca"), "ca is the authority's own name"),
        (("issue", "../leader"), "takes a NAME"),
        (("issue", "x", "--host", "a b"), "neither a host's name nor an address"),
        (("issue", "x", "--days", "soon"), "a whole number of days, not 'soon'"),
        (("issue", "x", "--dayz", "3"), "issue does not know --dayz"),
        (("revoke", "leader"), "no command 'revoke'"),
    ],
)
def test_a_mistake_is_one_line_and_changes_nothing(tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    folder = authority(tmp_path / "pki", "leader")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    done = pki(folder, *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_credentials_that_cannot_serve_are_named_before_anything_opens(tmp_path: Path) -> None:
    folder = tmp_path / "pki"
    with pytest.raises(ConfigError, match=r"ca.pem: cannot be read; deploy/pki.sh makes it"):
        check_credentials(folder, "follower")
    assert pki(folder, "ca").returncode == 0
    assert pki(folder, "issue", "follower", "--days", "10").returncode == 0
    assert 9 * 86_400 < check_credentials(folder, "follower") <= 10 * 86_400
    (folder / "follower.key").chmod(0o640)
    with pytest.raises(ConfigError, match=r"follower.key: others may read it"):
        check_credentials(folder, "follower")
    (folder / "follower.key").chmod(0o600)
    (folder / "follower.pem").write_text("nonsense")
    with pytest.raises(ConfigError, match=r"follower.pem: not a certificate"):
        check_credentials(folder, "follower")
