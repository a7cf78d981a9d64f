// SPDX-License-Identifier: MIT
// Files of SQLite next to an open run: they are applied only if they belong to it.
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

// Key of the -wal of the run `path`: (salt 1 - checkpoint number) mod 2^32 of its header. It stays
// as it is while one connection restarts the -wal. Others move it by a count of restarts, because
// SQLite counts them by connection. None: the file is missing or has no header.
std::optional<std::uint32_t> wal_key(const std::string& path);
// The -wal is missing, empty or zeros, and the run was bound to one or has records: some may be
// lost. A run that was killed before bind_wal() had written its key has lost none.
bool lacks_wal(const std::string& path);
// Makes the -wal of a run that this process begins to write, and stores its key in the run.
void bind_wal(sqlite3* db, const std::string& path);
// Before the -wal is emptied to close the run: a kill then loses nothing.
void unbind_wal(sqlite3* db, const std::string& path);
// Stores the key again if another connection made a new header, as after a TRUNCATE checkpoint.
void rebind_wal(sqlite3* db, const std::string& path);

// Throws Error(failed) if the key of the -wal is more than 65 536 restarts from that of the run.
// Accepts any -wal of a run without a key. Call before SQLite opens the run, while no process
// writes it.
void require_own_wal(const std::string& path);
// Throws Error(failed) if there is a -journal beside a -wal, or one with more than the first page.
// SQLite writes that page, without a -wal, when it closes a run.
void require_own_journal(const std::string& path);

}  // namespace echofuse::record
