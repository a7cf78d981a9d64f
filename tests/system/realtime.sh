#!/bin/sh
# SPDX-License-Identifier: MIT
# realtime.sh COMMAND... raises the priority of devices and daemon where permitted, and aborts a command that hangs.
# The command gets its own session, because Linux shares the processor between sessions and applies nice within a session.
# An aborted Python program prints the line at which it was waiting.
if [ "$1" != --here ]; then
  exec setsid -w "$0" --here "$@"
fi
shift
{ echo -10 > /proc/self/autogroup; } 2> /dev/null
export PYTHONFAULTHANDLER=1
deadline_s=${ECHOFUSE_TEST_DEADLINE_S:-240}
# No exec, because a session leader gets the first pty it opens as its terminal.
timeout --signal=ABRT --kill-after=10 "$deadline_s" nice -n -10 "$@"
code=$?
[ $code != 124 ] || echo "realtime.sh: no end within $deadline_s s: $*" >&2
exit $code
