#!/bin/sh
# SPDX-License-Identifier: MIT
# realtime.sh COMMAND...: devices and daemon go before what else the machine does, where that is permitted. A session
# of its own, as Linux shares the processor among sessions first and heeds nice only within one.
if [ "$1" != --here ]; then
  exec setsid -w "$0" --here "$@"
fi
shift
{ echo -10 > /proc/self/autogroup; } 2> /dev/null
nice -n -10 "$@"  # no exec: the leader of a session would get every pty it opens as its terminal
