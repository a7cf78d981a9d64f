// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::record {

// Adds an event of level "note" to a run; `who` is the source of the event. An open run is changed
// by a transaction. A closed run is locked and replaced by a copy that contains the note and has
// the same mode and owner. Throws Error(disk) if the disk does not have enough space for the copy,
// and Error(failed) if the -wal of the run is missing.
void put_note(const std::string& path, const std::string& text, const std::string& who);
// Adds an event of level "label". The recording process uses this label for all records from the
// current slot on. Throws Error(failed) if the run is not being recorded.
void put_label(const std::string& path, const std::string& label, const std::string& who);

}  // namespace echofuse::record
