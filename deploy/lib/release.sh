# Releases on disk: build, check, remove. Sourced by install.sh.
# shellcheck shell=bash disable=SC2154 # its variables

# pip, made quiet, of the environment $1
pip_of() { echo "$1/bin/python -m pip --quiet --disable-pip-version-check"; }

environment_of() { # what releases of the same lock share: 12 hex digits of lock and Python
  cat "$TREE/deploy/requirements.lock" <("$PYTHON" -VV) | sha256sum | cut -c1-12
}

build_environment() { # NAME: all packages but davpc's own
  local environment=$OPT/environments/$1 source=()
  [ ! -e "$environment/.complete" ] || return 0
  say "installing the locked packages"
  [ -z "$wheels" ] || source=(--no-index --find-links "$wheels")
  run rm -rf "$environment"
  run mkdir -p "$OPT/environments"
  run "$PYTHON" -m venv "$environment"
  # shellcheck disable=SC2046 # words are meant
  run $(pip_of "$environment") install "${source[@]}" --require-hashes -r "$TREE/deploy/requirements.lock" ||
    die "the packages could not be installed; nothing has changed"
  run touch "$environment/.complete"
}

build_release() { # ID
  local release=$OPT/releases/$1 environment=$OPT/environments/$(environment_of)
  [ ! -e "$release/.complete" ] || return 0
  build_environment "$(basename "$environment")"
  say "building release $1"
  run rm -rf "$release"
  run mkdir -p "$OPT/releases"
  run "$PYTHON" -m venv --without-pip "$release"
  run borrow "$environment" "$release"
  # shellcheck disable=SC2046
  run $(pip_of "$environment") --python "$release/bin/python" install --no-index --no-deps --no-build-isolation "$TREE" ||
    die "davpc itself could not be built; nothing has changed"
  run mkdir -p "$release/share/davpc"
  run cp -r "$TREE/deploy" "$TREE/docs" "$release/share/davpc/"
  run touch "$release/.complete"
}

borrow() { # ENVIRONMENT RELEASE: the release finds the environment's packages, and modules of vendors
  printf '%s\n' "$1"/lib/python3*/site-packages "$VENDOR" >"$(echo "$2"/lib/python3*/site-packages)/$BORROWED"
}

check_configuration() { # ID; the configuration must be one that this release can read
  [ -z "$dry_run" ] || return 0
  "$OPT/releases/$1/bin/python" - "$ETC/robots.toml" <<'PYTHON'
import sys
from pathlib import Path

from common.config import load_config
from common.errors import ConfigError

try:
    load_config(Path(sys.argv[1]))
except ConfigError as error:
    sys.exit(f"davpc: {error}")
PYTHON
}

prune() { # all but the current and the previous release, and the packages that neither uses
  local folder
  for folder in "$OPT"/releases/*; do
    case $(basename "$folder") in
    "$(linked current)" | "$(linked previous)" | '*') ;;
    *) run rm -rf "$folder" ;;
    esac
  done
  for folder in "$OPT"/environments/*; do
    [ ! -d "$folder" ] || grep -qs "^$folder/" "$OPT"/releases/*/lib/python3*/site-packages/"$BORROWED" ||
      run rm -rf "$folder"
  done
}
