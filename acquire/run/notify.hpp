// SPDX-License-Identifier: MIT
// Notifications of a run to systemd (sd_notify): ready with the first slot, then a heartbeat for
// every record on disk. Nothing is sent to anybody else: without NOTIFY_SOCKET all of it does
// nothing. Threading: the loop's thread. A call waits only while systemd itself stands still.
#pragma once
#include <cstdint>

namespace echofuse::acquire {

// The first slot begins. A watchdog shorter than four slots is asked to wait that long.
void notify_ready(double window_s);
// This many records are on disk; one more than at the last call, or more.
void notify_advance(std::int64_t records);
void notify_stopping();

}  // namespace echofuse::acquire
