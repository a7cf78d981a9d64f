// SPDX-License-Identifier: MIT
// Long run in parts: NAME-001.sqlite, NAME-002.sqlite and so on, each a run file. Parts have one
// uuid, and their records one numbering. Metadata give a part's number and the records of a full
// part. A part's name and metadata must agree: a copy under another name is a run by itself.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

struct Part {
  std::int64_t number = 0, records = 0;  // 1, 2 ... or 0: no part; of a full one
  std::int64_t first = 0;                // the index of its first record
  std::int64_t skipped = 0;              // numbers below its own that files of others had
};
Part part_of(const RunInfo& info);  // by its metadata alone
Part part_of(const std::string& path, const RunInfo& info);
// True for the keys that meta_of() makes.
bool is_key_of_part(const std::string& key);
std::vector<std::pair<std::string, std::string>> meta_of(const Part& part);

// NAME.sqlite and 2 make NAME-002.sqlite.
std::string part_path(const std::string& whole, std::int64_t number);
// Path of the whole and part number; for a name that is no part's, the path itself and 0.
std::pair<std::string, std::int64_t> whole_and_number(const std::string& path);
// Files of a run by their names: its one file as number 0, and those named like its parts.
std::map<std::int64_t, std::string> named_like(const std::string& whole);

// Reads a file that is named like a part; none if it is no part or cannot be read.
std::optional<RunInfo> read_part(const std::string& path);
// Path of the whole for a part's file; else the path itself.
std::string run_of(const std::string& file);

// Line that names the parts missing between two; empty: none is. `before` the first is Part{}.
// `next` behind the last has 0 records; the line then names no records.
std::string missing_between(const std::string& whole, const Part& before, const Part& next);

// Files of a run by its name: one, or its parts in order; the name alone if there is none. A file
// named like a part is missing if it cannot be read or is of another run than the first.
struct RunFiles {
  std::vector<std::string> paths;
  std::string missing;  // a line for each gap
};
RunFiles files_of(const std::string& name);

// The file into which the run of this name went on last: its one file, or its last part that can be
// read. However many there are, two or three are opened.
std::string last_file_of(const std::string& name);

// The part of this number, which is begun after `part` with the record `first_index`: with all that
// the run has beside its records and events. Throws as RunWriter.
std::unique_ptr<RunWriter> next_part(const std::string& part, std::int64_t number,
                                     std::int64_t first_index, const Clock& clock);

}  // namespace echofuse::record
