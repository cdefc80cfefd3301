"""Certificates: whatever keeps a gateway from serving is named."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from common.errors import ConfigError
from gateway.credentials import check_credentials


def _openssl(folder: Path, *words: str) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def _authority(folder: Path, name: str) -> None:
    make = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "30")
    _openssl(folder, *make, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem")


def _issue(folder: Path, name: str) -> None:
    make = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}")
    _openssl(folder, *make, "-keyout", f"{name}.key", "-out", f"{name}.csr")
    sign = ("x509", "-req", "-days", "20", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial")
    _openssl(folder, *sign, "-in", f"{name}.csr", "-out", f"{name}.pem")
    (folder / f"{name}.key").chmod(0o600)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _authority(tmp_path, "ca")
    _issue(tmp_path, "follower")
    return tmp_path


def test_a_good_certificate_has_time_left(folder: Path) -> None:
    assert 19 * 86400 < check_credentials(folder, "follower") <= 20 * 86400


def test_another_authority_is_named(folder: Path) -> None:
    _authority(folder, "other")
    (folder / "other.pem").rename(folder / "ca.pem")
    with pytest.raises(ConfigError, match=r"follower.pem: not signed by ca.pem"):
        check_credentials(folder, "follower")


def test_another_key_is_named(folder: Path) -> None:
    _issue(folder, "leader")
    (folder / "leader.key").rename(folder / "follower.key")
    with pytest.raises(ConfigError, match=r"follower.key: not the key of follower.pem"):
        check_credentials(folder, "follower")


def test_a_certificate_of_the_future_is_named(folder: Path) -> None:
    make = ("ca", "-batch", "-startdate", "20990101000000Z", "-enddate", "20990201000000Z")
    (folder / "index.txt").touch()
    (folder / "serial").write_text("1000\n")
    (folder / "ca.cnf").write_text(
        "[ca]\ndefault_ca=c\n[c]\ndatabase=index.txt\nserial=serial\nnew_certs_dir=.\ndefault_md=sha256\npolicy=p\n"
        "[p]\ncommonName=supplied\n"
    )
    signed = ("-cert", "ca.pem", "-keyfile", "ca.key", "-in", "follower.csr", "-out", "follower.pem")
    _openssl(folder, *make, "-config", "ca.cnf", "-notext", *signed)
    with pytest.raises(ConfigError, match=r"follower.pem: not valid before 2099-01-01"):
        check_credentials(folder, "follower")


def test_the_certificate_of_another_name_is_named(folder: Path) -> None:
    _issue(folder, "leader")
    for kind in ("pem", "key"):
        (folder / f"leader.{kind}").rename(folder / f"follower.{kind}")
    with pytest.raises(ConfigError, match=r"follower.pem: made for CN=leader, not for CN=follower"):
        check_credentials(folder, "follower")
