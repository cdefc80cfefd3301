#!/usr/bin/env bash
# The pair's certificates: an authority of your own, and one certificate for each robot, site router and operator.
set -euo pipefail
umask 077

usage() {
  cat <<'TEXT'
usage: pki.sh [--dir DIR] COMMAND

  ca [--days 3650]                          make the authority: ca.pem, ca.key
  issue NAME [--host HOST]... [--days 365]  make NAME.pem and NAME.key; HOST is a name or an IP address by which
                                            others connect to NAME (the name itself is always one)
  renew NAME [--days 365]                   a new certificate for the key that NAME has, with the same hosts
  expiry [--warn-days 30]                   say when each certificate expires; exit code 1 if one does within that time

DIR is ./pki. It stays with whoever administers the robots: a robot gets ca.pem, NAME.pem and NAME.key, never ca.key.
Names as in [network] of robots.toml: follower, leader, and those under operators and site_router.
Nothing is overwritten, but by renew: NAME.pem, whose predecessor stays as NAME.pem.old.
TEXT
}

fail() { echo "pki.sh: $*" >&2; exit 2; }
absent() { for file in "$@"; do [ ! -e "$file" ] || fail "$file exists; move it away first"; done; }
present() { for file in "$@"; do [ -r "$file" ] || fail "$file: cannot be read; $hint"; done; }
whole() { case $2 in ''|*[!0-9]*|0) fail "$1 takes a whole number of days, not '$2'";; esac; }

extensions() { # NAME HOST... : the certificate's extensions, one host each as DNS name or address
  local name=$1 host names="DNS:$1"
  shift
  for host in "$@"; do
    case $host in
      "$name") ;;
      *[!0-9.]*) case $host in *:*) names+=",IP:$host";; *) names+=",DNS:$host";; esac ;;
      *) names+=",IP:$host" ;;
    esac
  done
  printf '%s\n' "basicConstraints=critical,CA:false" "keyUsage=critical,digitalSignature" \
    "extendedKeyUsage=serverAuth,clientAuth" "subjectAltName=$names"
}

sign() { # NAME EXTENSIONS TARGET : have the authority sign NAME's key
  openssl req -new -key "$dir/$1.key" -subj "/CN=$1" |
    openssl x509 -req -CA "$dir/ca.pem" -CAkey "$dir/ca.key" -set_serial "0x$(openssl rand -hex 16)" -days "$days" \
      -sha256 -extfile <(printf '%s\n' "$2") -out "$3" 2>/dev/null
}

make_ca() {
  absent "$dir/ca.pem" "$dir/ca.key"
  mkdir -p "$dir"
  openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$dir/ca.key"
  openssl req -x509 -new -key "$dir/ca.key" -sha256 -days "$days" -subj "/CN=davpc authority" \
    -addext "basicConstraints=critical,CA:true,pathlen:0" -addext "keyUsage=critical,keyCertSign,cRLSign" \
    -out "$dir/ca.pem"
  echo "$dir/ca.pem: authority for $days days; keep $dir/ca.key off the robots"
}

issue() {
  hint="make the authority first: pki.sh ca"; present "$dir/ca.pem" "$dir/ca.key"
  absent "$dir/$name.pem" "$dir/$name.key"
  openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$dir/$name.key"
  sign "$name" "$(extensions "$name" ${hosts[@]+"${hosts[@]}"})" "$dir/$name.pem"
  echo "$dir/$name.pem: $name for $days days"
}

renew() {
  hint="make it first: pki.sh issue $name"; present "$dir/ca.pem" "$dir/ca.key" "$dir/$name.pem" "$dir/$name.key"
  local listed host
  listed=$(openssl x509 -in "$dir/$name.pem" -noout -ext subjectAltName | tail -n +2 | tr ',' '\n')
  hosts=()
  while read -r host; do hosts+=("${host#*:}"); done < <(sed -E 's/^ *//; s/IP Address:/IP:/' <<<"$listed")
  sign "$name" "$(extensions "$name" "${hosts[@]}")" "$dir/$name.pem.new"
  mv "$dir/$name.pem" "$dir/$name.pem.old"
  mv "$dir/$name.pem.new" "$dir/$name.pem"
  echo "$dir/$name.pem: $name for $days days; put it on the robot and restart its gateway"
}

expiry() {
  hint="nothing to look at"; present "$dir/ca.pem"
  local file end worst=0
  for file in "$dir"/*.pem; do
    end=$(openssl x509 -in "$file" -noout -enddate | cut -d= -f2)
    if openssl x509 -in "$file" -noout -checkend $((days * 86400)) >/dev/null; then
      echo "ok      $(basename "$file" .pem) until $end"
    elif openssl x509 -in "$file" -noout -checkend 0 >/dev/null; then
      echo "renew   $(basename "$file" .pem) until $end"; worst=1
    else
      echo "EXPIRED $(basename "$file" .pem) since $end"; worst=1
    fi
  done
  return $worst
}

dir=./pki days='' name='' hosts=() hint=''
command -v openssl >/dev/null || fail "openssl is not installed; on Debian: apt-get install openssl"
[ "${1:-}" = --dir ] && { [ $# -ge 2 ] || fail "--dir takes a folder"; dir=$2; shift 2; }
command=${1:-}
[ $# -gt 0 ] && shift
case $command in
  ca|expiry) ;;
  issue|renew)
    name=${1:-}
    [[ $name =~ ^[a-z0-9][a-z0-9.-]{0,62}$ ]] || fail "$command takes a NAME of small letters, digits, dots and dashes"
    [ "$name" != ca ] || fail "ca is the authority's own name"
    shift ;;
  ''|help|-h|--help) usage; exit 0 ;;
  *) fail "no command '$command'; see pki.sh help" ;;
esac
while [ $# -gt 0 ]; do
  [ $# -ge 2 ] || fail "$1 takes a value"
  case $command:$1 in
    issue:--host) [[ $2 =~ ^[0-9A-Za-z.:-]+$ ]] || fail "'$2' is neither a host's name nor an address"; hosts+=("$2") ;;
    ca:--days|issue:--days|renew:--days|expiry:--warn-days) whole "$1" "$2"; days=$2 ;;
    *) fail "$command does not know $1; see pki.sh help" ;;
  esac
  shift 2
done
case $command in
  ca) days=${days:-3650}; make_ca ;;
  issue) days=${days:-365}; issue ;;
  renew) days=${days:-365}; renew ;;
  expiry) days=${days:-30}; expiry ;;
esac
