#!/bin/sh
# SPDX-License-Identifier: MIT
# realtime.sh COMMAND...: devices and daemon go before what else the machine does, where that is permitted. A session
# of its own, as Linux shares the processor among sessions first and heeds nice only within one. With
# ECHOFUSE_RETRIED=FILE a command that fails is tried again, twice at most, and FILE tells which one.
if [ "$1" != --here ]; then
  exec setsid -w "$0" --here "$@"
fi
shift
{ echo -10 > /proc/self/autogroup; } 2> /dev/null
tries=1
# No exec: the leader of a session would get every pty it opens as its terminal.
until nice -n -10 "$@"; do
  code=$?
  if [ -z "$ECHOFUSE_RETRIED" ] || [ $code = 77 ] || [ $tries = 3 ]; then
    exit $code
  fi
  tries=$((tries + 1))
  echo "$*: try $tries" >> "$ECHOFUSE_RETRIED"
done
