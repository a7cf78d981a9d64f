// SPDX-License-Identifier: MIT
// A long run in parts: NAME-001.sqlite, NAME-002.sqlite and so on, each a run file. They have one
// uuid, their records one numbering, and their metadata the number of the part and the records that
// a full one has.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

struct Part {
  std::int64_t number = 0, records = 0;  // 1, 2 ... or 0: no part; of a full one
  std::int64_t first = 0;                // the index of its first record
};
Part part_of(const RunInfo& info);
// Of the metadata that meta_of() makes.
bool is_key_of_part(const std::string& key);
std::vector<std::pair<std::string, std::string>> meta_of(const Part& part);

// NAME.sqlite and 2 make NAME-002.sqlite.
std::string part_path(const std::string& whole, std::int64_t number);
// Of a part's path, that of the whole. Any other path stays.
std::string whole_of(const std::string& part);
// What is named like a part of this run, by its number.
std::map<std::int64_t, std::string> named_like_parts(const std::string& whole);

// The files of a run by its name: one, or its parts in order; the name alone if there is none.
// Throws Error(failed) for parts of two runs.
std::vector<std::string> files_of(const std::string& name);

// Of a part, all files of its run; of any other file, it alone.
std::vector<std::string> parts_beside(const std::string& file);

// The part that follows this one, with all that the run has beside its records and events. Throws
// as RunWriter.
std::unique_ptr<RunWriter> next_part(const std::string& part, const Clock& clock);

}  // namespace echofuse::record
