# Files outside a release: units, devices, configuration. Sourced by install.sh.
# shellcheck shell=bash disable=SC2154 # its variables

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
  if systemctl -q is-active systemd-udevd 2>/dev/null; then
    run udevadm control --reload
    run udevadm trigger --subsystem-match=usb --subsystem-match=net --action=change
  fi
  [ "$variant" = hardware ] || return 0
  if ! systemctl -q is-enabled systemd-networkd 2>/dev/null; then
    # it is to bring up can0; whether the network is online is left to others, as before
    run systemctl enable --now systemd-networkd
    run systemctl disable systemd-networkd-wait-online
  fi
  ! systemctl -q is-active systemd-networkd 2>/dev/null || run networkctl reload
}

write_configuration() { # ROBOT: templates where there is nothing yet
  local file
  mkdir_once "$ETC"
  for file in "$TREE"/deploy/config/*.eds; do
    [ -e "$ETC/$(basename "$file")" ] || put "$file" "$ETC/$(basename "$file")"
  done
  if [ ! -e "$ETC/robots.toml" ]; then
    run template "$ETC/robots.toml"
    [ -n "$dry_run" ] ||
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
