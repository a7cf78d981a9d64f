// SPDX-License-Identifier: MIT
// Checks that SQLite's side files of an open run belong to this run before SQLite applies them.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

struct sqlite3;

namespace echofuse::record {

// Key in the metadata of an open run. Its value, 8 hexadecimal digits, identifies the -wal.
inline constexpr const char* wal_key_name = "wal_key";
// SQL assignment that removes the key when the run is closed.
inline constexpr const char* without_wal_key = "meta = json_remove(meta, '$.wal_key')";

// Returns the key of the -wal of the run `path`; nothing if the -wal or its header is missing. The
// key is (salt 1 - checkpoint number) mod 2^32; the header contains both numbers. The key is
// constant while the same connection restarts the -wal. If another connection restarts the -wal,
// the key changes by a small number, because SQLite counts restarts per connection.
std::optional<std::uint32_t> wal_key(const std::string& path);
// Returns true if the -wal is missing, empty or filled with zeros, although the run was bound to a
// -wal or has records. Records may then be lost. A run that was killed before bind_wal() wrote its
// key has lost no records.
bool lacks_wal(const std::string& path);
// Creates the -wal of a new run and stores the key of the -wal in the run.
void bind_wal(sqlite3* db, const std::string& path);
// Marks the run as not bound to a -wal. Must be called before close() empties the -wal, so that
// readers accept the run if the process is then killed.
void unbind_wal(sqlite3* db, const std::string& path);
// Stores the key again if another connection created a new header, e.g. by a TRUNCATE checkpoint.
void rebind_wal(sqlite3* db, const std::string& path);

// Throws Error(failed) if the key of the -wal differs from the key in the run by more than 65 536.
// Accepts any -wal for a run without a key. Must be called before SQLite opens the run, and only
// while no process is writing it.
void require_own_wal(const std::string& path);
// Throws Error(failed) if the -journal is next to a -wal or contains more than the first page. When
// SQLite closes a run, its -journal contains only this page, and the -wal does not exist.
void require_own_journal(const std::string& path);

}  // namespace echofuse::record
