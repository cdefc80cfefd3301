#!/bin/sh
# Health of the process $1: its loop has reported within the last five seconds.
[ -n "$(find "/run/davpc/$1.alive" -newermt '-5 seconds' 2>/dev/null)" ]
