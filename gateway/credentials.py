"""A robot's certificate and key: where they are, and whether they can be used."""

from __future__ import annotations

import os
import ssl
import stat
import subprocess
from datetime import UTC, datetime
from pathlib import Path

from common.errors import ConfigError

_OPENSSL_S = 5.0


def credentials_folder(configured: str) -> Path:
    """Folder of the files: from systemd's LoadCredential=, else as configured."""
    return Path(os.environ.get("CREDENTIALS_DIRECTORY") or configured)


def check_credentials(folder: Path, certificate: str) -> float:
    """Check the files; returns the time until the certificate expires [s], by the wall clock.

    Raises:
        ConfigError: a file is missing, others may read the key, or the certificate cannot be read, is not
            valid now, is not signed by the authority beside it or not made for the key.
    """
    shown, key = folder / f"{certificate}.pem", folder / f"{certificate}.key"
    for file in (folder / "ca.pem", shown, key):
        if not os.access(file, os.R_OK):
            raise ConfigError(f"network.credentials: {file}: cannot be read; deploy/pki.sh makes it")
    if stat.S_IMODE(key.stat().st_mode) & 0o077:
        raise ConfigError(f"network.credentials: {key}: others may read it; chmod 600 it")
    since, until = _validity(shown)
    now = datetime.now(UTC).timestamp()
    if until <= now:
        raise ConfigError(f"network.credentials: {shown} has expired; deploy/pki.sh renew {certificate}")
    if since > now:
        day = datetime.fromtimestamp(since, UTC).date()
        raise ConfigError(f"network.credentials: {shown}: not valid before {day}: the computer's clock?")
    _check_fit(folder / "ca.pem", shown, key)
    return until - now


def _validity(certificate: Path) -> tuple[float, float]:
    """Begin and end, in seconds since 1970."""
    try:
        printed = _openssl("x509", "-noout", "-startdate", "-enddate", "-in", str(certificate))
    except subprocess.CalledProcessError as error:
        raise ConfigError(
            f"network.credentials: {certificate}: not a certificate; deploy/pki.sh makes one"
        ) from error
    since, until = (line.partition("=")[2] for line in printed.split("\n")[:2])
    return ssl.cert_time_to_seconds(since), ssl.cert_time_to_seconds(until)


def _check_fit(authority: Path, certificate: Path, key: Path) -> None:
    """The certificate is of its file's name, the key is its own, and the authority signed it."""
    subject = _openssl("x509", "-noout", "-subject", "-nameopt", "RFC2253", "-in", str(certificate))
    found = subject.strip().removeprefix("subject=")
    if f"CN={certificate.stem}" not in found.split(","):
        raise ConfigError(f"network.credentials: {certificate}: made for {found}, not for CN={certificate.stem}")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, ValueError) as error:
        raise ConfigError(
            f"network.credentials: {key}: not the key of {certificate.name}; deploy/pki.sh issue makes both"
        ) from error
    try:
        _openssl("verify", "-no_check_time", "-CAfile", str(authority), str(certificate))
    except subprocess.CalledProcessError as error:
        raise ConfigError(
            f"network.credentials: {certificate}: not signed by {authority.name}; deploy/pki.sh issue"
        ) from error


def _openssl(*words: str) -> str:
    try:
        done = subprocess.run(["openssl", *words], capture_output=True, text=True, check=True, timeout=_OPENSSL_S)
    except FileNotFoundError as error:
        raise ConfigError("openssl is not installed; on Debian: apt-get install openssl") from error
    except subprocess.TimeoutExpired as error:
        raise ConfigError(f"network.credentials: openssl {words[0]}: no answer in {_OPENSSL_S:.0f} s") from error
    return done.stdout
