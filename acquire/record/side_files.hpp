// SPDX-License-Identifier: MIT
// SQLite's side files of an open run, which are applied only if they belong to it.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

struct sqlite3;

namespace echofuse::record {

// Member of run.meta of an open run: the key of its -wal, 8 hexadecimal digits.
inline constexpr const char* wal_key_name = "wal_key";
// Assignment that removes the key, when the run closes.
inline constexpr const char* without_wal_key = "meta = json_remove(meta, '$.wal_key')";

// Returns the key of the -wal of the run `path`: (salt 1 - checkpoint number) mod 2^32 of its
// header. The key is constant while one connection restarts the -wal. Other connections change it
// by a number of restarts, because SQLite counts them per connection. Returns nothing if the file
// or its header is missing.
std::optional<std::uint32_t> wal_key(const std::string& path);
// Returns true if the -wal is missing, empty or zeros, and the run was bound to one or has records:
// some may be lost. A run killed before bind_wal() wrote its key has lost none.
bool lacks_wal(const std::string& path);
// Creates the -wal of a run that this process begins to write, and stores its key in the run.
void bind_wal(sqlite3* db, const std::string& path);
// Call before the -wal is emptied to close the run, so that a kill loses nothing.
void unbind_wal(sqlite3* db, const std::string& path);
// Stores the key again if another connection created a new header, e.g. by a TRUNCATE checkpoint.
void rebind_wal(sqlite3* db, const std::string& path);

// Throws Error(failed) if the key of the -wal is more than 65 536 restarts from the run's key.
// Accepts any -wal for a run without a key. Call before SQLite opens the run, while no process
// writes it.
void require_own_wal(const std::string& path);
// Throws Error(failed) for a -journal next to a -wal, or with more than the first page. SQLite
// writes only that page, and without a -wal, when it closes a run.
void require_own_journal(const std::string& path);

}  // namespace echofuse::record
