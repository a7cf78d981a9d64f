#!/bin/sh
# SPDX-License-Identifier: MIT
# realtime.sh COMMAND...: raises the priority of devices and daemon where permitted. Uses a separate session, because
# Linux shares the processor between sessions and applies nice only within one. With ECHOFUSE_RETRIED=FILE a failed
# command is repeated at most twice and listed in FILE.
if [ "$1" != --here ]; then
  exec setsid -w "$0" --here "$@"
fi
shift
{ echo -10 > /proc/self/autogroup; } 2> /dev/null
tries=1
# No exec, because a session leader gets the first pty it opens as its terminal.
until nice -n -10 "$@"; do
  code=$?
  if [ -z "$ECHOFUSE_RETRIED" ] || [ $code = 77 ] || [ $tries = 3 ]; then
    exit $code
  fi
  tries=$((tries + 1))
  echo "$*: try $tries" >> "$ECHOFUSE_RETRIED"
done
