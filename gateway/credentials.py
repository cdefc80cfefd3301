"""A robot's certificate and key: where they are, and whether they can be used."""

from __future__ import annotations

import os
import ssl
import stat
import subprocess
from datetime import UTC, datetime
from pathlib import Path

from common.errors import ConfigError


def credentials_folder(configured: str) -> Path:
    """Folder of the files: from systemd's LoadCredential=, else as configured."""
    return Path(os.environ.get("CREDENTIALS_DIRECTORY") or configured)


def check_credentials(folder: Path, certificate: str) -> float:
    """Check the files; returns the time until the certificate expires [s], by the wall clock.

    Raises:
        ConfigError: a file is missing, others may read the key, or the certificate cannot be read or has expired.
    """
    shown, key = folder / f"{certificate}.pem", folder / f"{certificate}.key"
    for file in (folder / "ca.pem", shown, key):
        if not os.access(file, os.R_OK):
            raise ConfigError(f"network.credentials: {file}: cannot be read; deploy/pki.sh makes it")
    if stat.S_IMODE(key.stat().st_mode) & 0o077:
        raise ConfigError(f"network.credentials: {key}: others may read it; chmod 600 it")
    left_s = _seconds_left(shown)
    if left_s <= 0:
        raise ConfigError(f"network.credentials: {shown} has expired; deploy/pki.sh renew {certificate}")
    return left_s


def _seconds_left(certificate: Path) -> float:
    command = ["openssl", "x509", "-noout", "-enddate", "-in", str(certificate)]
    try:
        printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except FileNotFoundError as error:
        raise ConfigError("openssl is not installed; on Debian: apt-get install openssl") from error
    except subprocess.CalledProcessError as error:
        raise ConfigError(
            f"network.credentials: {certificate}: not a certificate; deploy/pki.sh makes one"
        ) from error
    return ssl.cert_time_to_seconds(printed.strip().removeprefix("notAfter=")) - datetime.now(UTC).timestamp()
