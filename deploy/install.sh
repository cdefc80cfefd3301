#!/usr/bin/env bash
# Installs davpc on a robot's computer: Debian 12 or Ubuntu 24.04, or any other with systemd >= 252 and Python >= 3.11.
#
#   install.sh follower|leader [--wheels DIR] [--simulated] [--start] [--restart] [--dry-run]
#       --wheels DIR   take packages from this folder, not from the network; made by `install.sh wheels DIR`
#       --simulated    drives, I/O and light are simulated; the Follower's machine runs the world
#       --start        start the robot's processes now and at every boot
#       --restart      may stop the robot's running processes for the upgrade
#       --dry-run      print what would be done, do nothing
#   install.sh rollback [--dry-run]             back to the release before this one
#   install.sh uninstall [--purge] [--dry-run]  remove all but configuration, calibration and their owner, the user
#                                               davpc; --purge: these too
#   install.sh wheels DIR                       gather the packages, on a machine with network and the same Python
#
# A release is a folder of /opt/davpc/releases with a virtual environment and its units; releases with the same lock
# share the packages in /opt/davpc/environments. /opt/davpc/current points to the release in use, /opt/davpc/previous
# to the one before. /etc/davpc is yours: existing files are never changed.
# If an upgraded robot does not become healthy, the previous release is restored. A second run changes nothing.
set -euo pipefail
umask 022

TREE=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
OPT=/opt/davpc
ETC=/etc/davpc
LIB=/usr/local/lib
PYTHON=${PYTHON:-/usr/bin/python3}
HEALTHY_S=5        # so long every process must run without a restart
HEALTH_WAIT_S=40   # within this
BORROWED=davpc-packages.pth
VENDOR=/usr/local/lib/davpc # Python modules of device vendors, put there by hand
PACKAGED=(common follower gateway leader sim station experiments deploy docs pyproject.toml README.md LICENSE)

dry_run="" wheels="" variant=hardware start="" restart="" purge="" changed=0 last_but_one=""

say() { echo "davpc: $*"; }
die() { echo "davpc: $*" >&2; exit 2; }
run() { changed=$((changed + 1)); if [ -n "$dry_run" ]; then echo "  would run: $*"; else "$@"; fi; }

alone_as_root() { # for what changes the machine
  [ -z "$dry_run" ] || return 0
  [ "$(id -u)" = 0 ] || die "run as root: sudo $0 $*"
  exec 9>/run/davpc-install.lock
  flock -n 9 || die "another install.sh is at work"
}

# --- what is installed, what is requested

check_machine() {
  [ -d /run/systemd/system ] || [ -n "$dry_run" ] || die "systemd does not run on this machine"
  local version
  version=$(systemctl --version 2>/dev/null | awk 'NR == 1 { print $2 }')
  [ "${version:-0}" -ge 252 ] || die "systemd ${version:-(none)} is too old, 252 is needed: Debian 12, Ubuntu 24.04"
  check_python
  [ -z "$wheels" ] || [ -n "$(find "$wheels" -name '*.whl' -print -quit 2>/dev/null)" ] ||
    die "--wheels $wheels: no wheels there; make the folder with '$0 wheels DIR' on a machine with network"
}

check_python() {
  "$PYTHON" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
    die "$PYTHON is not Python >= 3.11 with venv: apt-get install python3-venv, or PYTHON=... $0"
}

# name of the release of this tree: its version and a digest of its files
release_id() {
  local version content
  version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$TREE/pyproject.toml" | head -1)
  content=$(cd "$TREE" && find "${PACKAGED[@]}" -type f ! -path '*/__pycache__/*' -print0 | LC_ALL=C sort -z |
    xargs -0 sha256sum | sha256sum | cut -c1-12)
  echo "$version-$content"
}

target_of() { [ ! -r "$ETC/robot" ] || echo "davpc-$(cut -d' ' -f1 "$ETC/robot").target"; }
linked() { basename "$(readlink "$OPT/$1" 2>/dev/null || true)"; }
is_running() { [ -n "$(target_of)" ] && systemctl -q is-active "$(target_of)" 2>/dev/null; }

refuse_other_robot() { # ROBOT: two robots' processes on one real bus would both be its master
  local installed
  installed=$(target_of)
  [ -n "$installed" ] && [ "$installed" != "davpc-$1.target" ] || return 0
  ! systemctl -q is-active "$installed" 2>/dev/null && ! systemctl -q is-enabled "$installed" 2>/dev/null ||
    die "this computer runs $installed or starts it at boot: 'systemctl disable --now $installed' first"
}

# --- parts

# shellcheck source=deploy/lib/release.sh
. "$TREE/deploy/lib/release.sh"
# shellcheck source=deploy/lib/files.sh
. "$TREE/deploy/lib/files.sh"

# --- the release in use

point() { run ln -sfn "releases/$2" "$OPT/$1.new" && run mv -T "$OPT/$1.new" "$OPT/$1"; }

use_release() { # ID
  sync_files "$1"
  if [ "$(linked current)" != "$1" ]; then
    [ -z "$(linked current)" ] || point previous "$(linked current)"
    point current "$1"
  fi
  if [ ! -e /usr/local/bin/davpc ] && [ ! -h /usr/local/bin/davpc ]; then
    run ln -s "$OPT/current/bin/davpc" /usr/local/bin/davpc
  fi
}

states() { # UNIT...: "name state restarts" of each that is meant to run: all but those whose condition says no
  systemctl show -p Id,ActiveState,NRestarts,ConditionResult,ConditionTimestampMonotonic "$@" | awk -v RS= '{
    for (i = 1; i <= NF; i++) { split($i, pair, "="); is[pair[1]] = pair[2] }
    # the condition of a unit that still waits for its device has not been checked yet
    if (is["ConditionResult"] == "yes" || is["ActiveState"] == "active" || is["ConditionTimestampMonotonic"] == 0)
      print is["Id"], is["ActiveState"], is["NRestarts"]
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
  # if the safe target has stopped all other units, name those that failed
  now=$(systemctl list-units --plain --no-legend --state=failed 'davpc-*')
  [ -n "$now" ] || now=$(states "${units[@]}" | awk '$2 != "active"')
  say "not healthy: $(awk '{ print $1 }' <<<"$now" | xargs)" >&2
  journalctl -q -b -p err -n 5 --no-hostname -o cat >&2 || true
  return 1
}

start_and_check() { # TARGET
  run systemctl reset-failed 'davpc-*'
  run systemctl start "$1" || return 1
  [ -n "$dry_run" ] || healthy "$1"
}

# --- commands

install_robot() { # ROBOT
  local id target=davpc-$1.target before was_running=""
  check_machine
  id=$(release_id) before=$(linked current) last_but_one=$(linked previous)
  refuse_other_robot "$1"
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
  [ -z "$dry_run" ] || { say "dry run: nothing has been changed"; return; }
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
  [ -z "$dry_run" ] || { say "dry run: nothing has been changed"; return; }
  say "release $id is in use again"
}

uninstall() {
  local file
  for file in follower leader; do
    [ ! -e "$LIB/systemd/system/davpc-$file.target" ] || run systemctl disable --now "davpc-$file.target"
  done
  while read -r file; do run rm -f "$file"; done < <(installed_files)
  run find "$LIB/systemd" -depth -type d -name 'davpc*' -exec rmdir {} +
  [ "$(readlink /usr/local/bin/davpc)" != "$OPT/current/bin/davpc" ] || run rm /usr/local/bin/davpc
  run rm -rf "$OPT" /run/davpc
  run systemctl daemon-reload
  if [ -n "$purge" ]; then
    run rm -rf "$ETC" /var/lib/davpc
    ! getent passwd davpc >/dev/null || run userdel davpc
  else # files of a user who is gone would be the next one's who gets his number
    say "$ETC, /var/lib/davpc and the user davpc, their owner, stay; --purge removes them"
  fi
  if [ -n "$dry_run" ]; then say "dry run: nothing has been changed"; else say "uninstalled"; fi
}

gather_wheels() { # DIR
  check_python
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  "$PYTHON" -m venv "$scratch"
  "$scratch/bin/python" -m pip download --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
    --dest "$1" -r "$TREE/deploy/requirements.lock"
  say "$1: packages for $("$PYTHON" --version) on $(uname -m)"
}

command=${1:-}
[ $# = 0 ] || shift
case " $* " in *' --help '* | *' -h '*) command=--help && set -- ;; esac
folder=""
if [ "$command" = wheels ]; then
  [ -n "${1:-}" ] && [ "${1#-}" = "$1" ] || die "wheels takes the folder to put them into: $0 wheels DIR"
  folder=$1 && shift
fi
while [ $# -gt 0 ]; do
  case $command:$1 in
  follower:--wheels | leader:--wheels) wheels=${2:-} && [ -n "$wheels" ] || die "--wheels takes a folder" && shift ;;
  follower:--simulated | leader:--simulated) variant=simulated ;;
  follower:--start | leader:--start) start=1 ;;
  follower:--restart | leader:--restart) restart=1 ;;
  uninstall:--purge) purge=1 ;;
  follower:--dry-run | leader:--dry-run | rollback:--dry-run | uninstall:--dry-run) dry_run=1 ;;
  *) die "$command does not know $1; '$0 --help' lists what there is" ;;
  esac
  shift
done
case $command in
follower | leader) alone_as_root "$command" && install_robot "$command" ;;
rollback | uninstall) alone_as_root "$command" && "$command" ;;
wheels) gather_wheels "$folder" ;;
-h | --help) sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0" ;;
*) die "what to do? '$0 --help' lists it" ;;
esac
