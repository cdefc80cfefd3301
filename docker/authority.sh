#!/usr/bin/env bash
# The pair's authority, for the simulated deployment: makes missing certificates, gives each robot its own, and keeps running.
# On real robots the operator does this, see docs/network.md: keep the authority's key away from the robots.
set -euo pipefail
[ -e /pki/ca.pem ] || pki.sh --dir /pki ca
for robot in follower leader; do
  [ -e "/pki/$robot.pem" ] || pki.sh --dir /pki issue "$robot"
  for file in ca.pem "$robot.pem" "$robot.key"; do
    install -m 0600 "/pki/$file" "/$robot/$file"
  done
done
touch /tmp/ready
trap 'exit 0' TERM
sleep infinity &
wait
