#!/usr/bin/env bash
# Installs davpc on a robot's computer: Debian 12 or Ubuntu 24.04, or any other with systemd >= 252 and Python >= 3.11.
#
#   install.sh follower|leader [--wheels DIR] [--simulated] [--start] [--restart] [--dry-run]
#       --wheels DIR   take packages from this folder, not from the network; made by `install.sh wheels DIR`
#       --simulated    drives, I/O and light are simulated; the Follower's machine runs the world
#       --start        start the robot's processes now and at every boot
#       --restart      allow to stop the robot, if its processes run, for the upgrade
#       --dry-run      say what would be done, do nothing
#   install.sh rollback [--dry-run]             back to the release before this one
#   install.sh uninstall [--purge] [--dry-run]  remove all but configuration and calibration; --purge: these too
#   install.sh wheels DIR                       gather the packages, on a machine with network and the same Python
#
# A release is a folder of /opt/davpc/releases with a virtual environment and its units; releases with the same lock
# share the packages in /opt/davpc/environments. /opt/davpc/current points to the release in use, /opt/davpc/previous
# to the one before. /etc/davpc is yours: a file that is there is never touched.
# If an upgraded robot does not come up healthy, the release before is put back. A second run changes nothing.
set -euo pipefail

TREE=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
OPT=/opt/davpc
ETC=/etc/davpc
LIB=/usr/local/lib
PYTHON=${PYTHON:-/usr/bin/python3}
HEALTHY_S=5        # so long every process must run without a restart
HEALTH_WAIT_S=40   # within this
BORROWED=davpc-packages.pth
PACKAGED=(common follower leader sim station experiments deploy docs pyproject.toml README.md LICENSE)

dry_run="" wheels="" variant=hardware start="" restart="" purge="" changed=0 last_but_one=""

say() { echo "davpc: $*"; }
die() { echo "davpc: $*" >&2; exit 2; }
run() { changed=$((changed + 1)); if [ -n "$dry_run" ]; then echo "  would run: $*"; else "$@"; fi; }
need_root() { [ "$(id -u)" = 0 ] || [ -n "$dry_run" ] || die "run as root: sudo $0 $*"; }

# --- what is there, what is wanted

check_machine() {
  command -v systemctl >/dev/null || die "no systemd on this machine"
  local version
  version=$(systemctl --version | awk 'NR == 1 { print $2 }')
  [ "$version" -ge 252 ] || die "systemd $version is too old, 252 is needed: Debian 12, Ubuntu 24.04 or newer"
  "$PYTHON" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
    die "$PYTHON is not Python >= 3.11 with venv: apt-get install python3-venv, or PYTHON=... $0"
  [ -z "$wheels" ] || [ -n "$(find "$wheels" -name '*.whl' -print -quit 2>/dev/null)" ] ||
    die "--wheels $wheels: no wheels there; make the folder with '$0 wheels DIR' on a machine with network"
}

# name of the release that this tree makes: version, and what its files are
release_id() {
  local version content
  version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$TREE/pyproject.toml" | head -1)
  content=$(cd "$TREE" && find "${PACKAGED[@]}" -type f ! -path '*/__pycache__/*' -print0 | LC_ALL=C sort -z |
    xargs -0 sha256sum | sha256sum | cut -c1-12)
  echo "$version-$content"
}

target_of() { [ -r "$ETC/robot" ] && echo "davpc-$(cut -d' ' -f1 "$ETC/robot").target"; }
linked() { basename "$(readlink "$OPT/$1" 2>/dev/null || true)"; }
is_running() { [ -n "$(target_of)" ] && systemctl -q is-active "$(target_of)"; }

# --- a release on the disk

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
  run $(pip_of "$environment") --python "$release/bin/python" install --no-index --no-deps --no-build-isolation "$TREE"
  run mkdir -p "$release/share/davpc"
  run cp -r "$TREE/deploy" "$TREE/docs" "$release/share/davpc/"
  run touch "$release/.complete"
}

borrow() { # ENVIRONMENT RELEASE: the release finds the environment's packages
  echo "$1"/lib/python3*/site-packages >"$(echo "$2"/lib/python3*/site-packages)/$BORROWED"
}

check_configuration() { # ID; the configuration must be one that this release can read
  [ -z "$dry_run" ] || return 0
  "$OPT/releases/$1/bin/python" - "$ETC/robots.toml" <<'PYTHON'
import sys
from pathlib import Path

from common.config import ConfigError, load_config

try:
    load_config(Path(sys.argv[1]))
except ConfigError as error:
    sys.exit(f"davpc: {error}")
PYTHON
}

# --- files outside the release

put() { # SOURCE DESTINATION: copy if different
  if [ -h "$1" ]; then
    [ "$(readlink "$1")" = "$(readlink "$2" 2>/dev/null)" ] && return
    mkdir_once "$(dirname "$2")"
    run ln -sfn "$(readlink "$1")" "$2"
  elif ! cmp -s "$1" "$2"; then
    run install -D -m 0644 "$1" "$2"
  fi
}

units_of() { # RELEASE: "source destination" of every file that it has outside its folder
  local deploy=$OPT/releases/$1/share/davpc/deploy folder path
  [ -d "$deploy" ] || deploy=$TREE/deploy # a dry run before the release is there
  for folder in "$deploy/systemd" "$deploy/$variant"; do
    (cd "$folder" && find . ! -type d) | while read -r path; do
      echo "$folder/$path" "$LIB/systemd/system/${path#./}"
    done
  done
  echo "$deploy/sysusers.conf $LIB/sysusers.d/davpc.conf"
  echo "$deploy/tmpfiles.conf $LIB/tmpfiles.d/davpc.conf"
  echo "$deploy/udev/70-davpc-camera.rules $LIB/udev/rules.d/70-davpc-camera.rules"
  if [ "$variant" = hardware ]; then
    for path in link network; do
      echo "$deploy/can/80-davpc-can.$path $LIB/systemd/network/80-davpc-can.$path"
    done
  fi
}

installed_files() {
  find "$LIB/systemd/system" "$LIB/systemd/network" "$LIB/sysusers.d" "$LIB/tmpfiles.d" "$LIB/udev/rules.d" \
    ! -type d \( -path '*/davpc[-_.]*' -o -name '??-davpc-*' \) 2>/dev/null || true
}

sync_files() { # ID
  local before=$changed source destination wanted
  wanted=$(units_of "$1")
  while read -r destination; do
    grep -qF " $destination" <<<"$wanted" || run rm -f "$destination"
  done < <(installed_files)
  while read -r source destination; do
    put "$source" "$destination"
  done <<<"$wanted"
  [ "$changed" != "$before" ] || return 0
  run find "$LIB/systemd/system" -type d -name 'davpc*' -empty -delete
  run systemd-sysusers "$LIB/sysusers.d/davpc.conf"
  run systemd-tmpfiles --create "$LIB/tmpfiles.d/davpc.conf"
  run systemctl daemon-reload
  reload_devices
}

mkdir_once() { [ -d "$1" ] || run mkdir -p "$1"; }

reload_devices() {
  if systemctl -q is-active systemd-udevd; then
    run udevadm control --reload
    run udevadm trigger --subsystem-match=usb --subsystem-match=net --action=change
  fi
  [ "$variant" = hardware ] || return 0
  if ! systemctl -q is-enabled systemd-networkd 2>/dev/null; then
    # it is to bring up can0; whether the network is online is somebody else's business, as before
    run systemctl enable --now systemd-networkd
    run systemctl disable systemd-networkd-wait-online
  fi
  ! systemctl -q is-active systemd-networkd || run networkctl reload
}

write_configuration() { # ROBOT: templates where there is nothing yet
  local file
  mkdir_once "$ETC"
  for file in "$TREE"/deploy/config/*.eds; do
    [ -e "$ETC/$(basename "$file")" ] || put "$file" "$ETC/$(basename "$file")"
  done
  if [ ! -e "$ETC/robots.toml" ]; then
    run template "$ETC/robots.toml"
    say "wrote $ETC/robots.toml: put the pair's measures in, the same file on both robots"
  fi
  if [ "$(cat "$ETC/robot" 2>/dev/null)" != "$1 $variant" ]; then
    run write "$ETC/robot" "$1 $variant"
  fi
}

write() { echo "$2" >"$1"; }

template() { # FILE
  if [ "$variant" = simulated ]; then
    cp "$TREE/deploy/config/robots.toml" "$1"
  else
    sed -e '/^\[world\]/,$d' -e 's/^driver = "sim" /driver = "mindvision" /' \
      -e 's/^bus = .*/bus = { interface = "socketcan", channel = "can0" }/' "$TREE/deploy/config/robots.toml" >"$1"
  fi
  chmod 0644 "$1"
}

# --- which release is in use

point() { run ln -sfn "releases/$2" "$OPT/$1.new" && run mv -T "$OPT/$1.new" "$OPT/$1"; }

use_release() { # ID
  sync_files "$1"
  if [ "$(linked current)" != "$1" ]; then
    [ -z "$(linked current)" ] || point previous "$(linked current)"
    point current "$1"
  fi
  [ "$(readlink /usr/local/bin/davpc 2>/dev/null)" = "$OPT/current/bin/davpc" ] ||
    run ln -s "$OPT/current/bin/davpc" /usr/local/bin/davpc
}

states() { # UNIT...: "name state restarts" of each that is meant to run
  systemctl show -p Id,ActiveState,NRestarts,ConditionResult "$@" | awk -v RS= '{
    for (i = 1; i <= NF; i++) { split($i, pair, "="); is[pair[1]] = pair[2] }
    if (is["ConditionResult"] == "yes" || is["ActiveState"] == "active") print is["Id"], is["ActiveState"], is["NRestarts"]
  }'
}

healthy() { # TARGET: every process of it runs, and none has been restarted for a while
  local units now before="" since=$SECONDS deadline=$((SECONDS + HEALTH_WAIT_S))
  read -ra units <<<"$(systemctl show -P Wants "$1")"
  while [ "$SECONDS" -lt "$deadline" ] && systemctl -q is-active "$1"; do
    now=$(states "${units[@]}")
    if [ "$now" != "$before" ] || awk '$2 != "active" { bad = 1 } END { exit !bad }' <<<"$now"; then
      before=$now since=$SECONDS
    fi
    [ $((SECONDS - since)) -lt "$HEALTHY_S" ] || return 0
    sleep 0.2
  done
  # if the safe target has stopped all the others, those that failed are to blame
  now=$(systemctl list-units --plain --no-legend --state=failed 'davpc-*')
  [ -n "$now" ] || now=$(states "${units[@]}" | awk '$2 != "active"')
  say "not healthy: $(awk '{ print $1 }' <<<"$now" | xargs)" >&2
  journalctl -q -b -p err -n 5 --no-hostname -o cat >&2 || true
  return 1
}

start_and_check() { # TARGET
  run systemctl reset-failed
  run systemctl start "$1" || return 1
  [ -n "$dry_run" ] || healthy "$1"
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

# --- commands

install_robot() { # ROBOT
  local id target=davpc-$1.target before was_running=""
  check_machine
  id=$(release_id) before=$(linked current) last_but_one=$(linked previous)
  if is_running; then
    was_running=1
    [ "$before" = "$id" ] || [ -n "$restart" ] || [ -n "$dry_run" ] ||
      die "the robot's processes run: 'systemctl stop $target' first, or add --restart"
  fi
  build_release "$id"
  write_configuration "$1"
  check_configuration "$id" || die "release $id cannot use this configuration; nothing has been switched"
  if [ -n "$was_running" ] && [ "$before" != "$id" ]; then run systemctl stop "$target"; fi
  use_release "$id"
  if [ -n "$start" ]; then
    systemctl -q is-enabled "$target" 2>/dev/null || run systemctl enable "$target"
  fi
  if [ -n "$start$was_running" ] && ! is_running; then
    start_and_check "$target" || switch_back "$before" "$target"
  fi
  [ "$changed" != 0 ] || { say "release $id is installed; nothing changed"; return; }
  prune
  say "release $id is installed for the $1 ($variant)"
  [ -n "$start$was_running" ] || say "when $ETC is complete: systemctl enable --now $target"
}

switch_back() { # ID TARGET
  run systemctl stop "$2"
  [ -n "$1" ] && [ "$1" != "$(linked current)" ] ||
    die "this release is not healthy, and there is none to go back to; when mended: systemctl start $2"
  say "switching back to $1" >&2
  use_release "$1"
  if [ -n "$last_but_one" ]; then point previous "$last_but_one"; else run rm "$OPT/previous"; fi
  start_and_check "$2" || die "release $1 is not healthy either: see journalctl -b"
  die "the new release was not healthy; release $1 is in use again"
}

rollback() {
  local id target was_running=""
  id=$(linked previous) target=$(target_of)
  [ -n "$id" ] && [ -n "$target" ] || die "there is no earlier release"
  variant=$(cut -d' ' -f2 "$ETC/robot")
  check_configuration "$id" || die "release $id cannot use this configuration; nothing has been switched"
  if is_running; then was_running=1 && run systemctl stop "$target"; fi
  use_release "$id"
  if [ -n "$was_running" ]; then start_and_check "$target" || die "release $id is in use, but not healthy"; fi
  say "release $id is in use again"
}

uninstall() {
  local file
  for file in follower leader; do
    [ ! -e "$LIB/systemd/system/davpc-$file.target" ] || run systemctl disable --now "davpc-$file.target"
  done
  while read -r file; do run rm -f "$file"; done < <(installed_files)
  run find "$LIB/systemd" -depth -type d -name 'davpc*' -exec rmdir {} +
  [ ! -h /usr/local/bin/davpc ] || run rm -f /usr/local/bin/davpc
  run rm -rf "$OPT" /run/davpc
  run systemctl daemon-reload
  ! getent passwd davpc >/dev/null || run userdel davpc
  if [ -n "$purge" ]; then run rm -rf "$ETC" /var/lib/davpc; else say "$ETC and /var/lib/davpc stay; --purge removes them"; fi
  say "uninstalled"
}

gather_wheels() { # DIR
  check_machine
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  "$PYTHON" -m venv "$scratch"
  "$scratch/bin/python" -m pip download --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
    --dest "$1" -r "$TREE/deploy/requirements.lock"
  say "$1: packages for $("$PYTHON" --version) on $(uname -m)"
}

command=${1:-} && shift || true
folder=""
if [ "$command" = wheels ]; then folder=${1:?which folder} && shift; fi
while [ $# -gt 0 ]; do
  case $1 in
  --wheels) wheels=${2:?--wheels needs a folder} && shift ;;
  --simulated) variant=simulated ;;
  --start) start=1 ;;
  --restart) restart=1 ;;
  --purge) purge=1 ;;
  --dry-run) dry_run=1 ;;
  *) die "unknown option $1; '$0 --help' lists them" ;;
  esac
  shift
done
case $command in
follower | leader) need_root "$command" && install_robot "$command" ;;
rollback | uninstall) need_root "$command" && "$command" ;;
wheels) gather_wheels "$folder" ;;
-h | --help) sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" ;;
*) die "what to do? '$0 --help' lists it" ;;
esac
