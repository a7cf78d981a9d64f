// SPDX-License-Identifier: MIT
#include "acquire/record/side_files.hpp"

#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <string_view>

#include "acquire/record/run_guard.hpp"
#include "acquire/record/sqlite.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {
namespace {

using FileHead = std::array<std::uint8_t, 32>;
// Maximum number of bytes that are read from a journal; exceeds one sector plus one page.
constexpr std::size_t max_journal_bytes = 1 << 18;

// Returns the first bytes of a file, padded with zeros.
FileHead header_of(const RegularFile& file) {
  FileHead out{};
  static_cast<void>(file.read(out));
  return out;
}

std::uint32_t big_endian(const std::uint8_t* bytes) {
  std::uint32_t out = 0;
  for (int i = 0; i < 4; ++i) out = out << 8 | bytes[i];
  return out;
}

FileHead wal_header(const std::string& path) {
  const std::string name = path + "-wal";
  return ::access(name.c_str(), F_OK) == 0 ? header_of({name, ExitCode::failed}) : FileHead{};
}

std::string text_of(std::optional<std::uint32_t> key) {
  return key ? format("%08x", *key) : "none";
}

// Compares the key of a -wal with the stored key. Accepts any -wal if the run has no stored key.
bool is_own(std::uint32_t found, const std::string& stored) {
  constexpr std::int64_t max_restarts = 1 << 16;
  std::uint32_t expected = 0;
  if (stored.size() != 8 || std::sscanf(stored.c_str(), "%8x", &expected) != 1) return true;
  return std::abs(std::int64_t{static_cast<std::int32_t>(found - expected)}) <= max_restarts;
}

void put_key(sqlite3* db, const std::string& path, const std::string& key) {
  Statement(db, path, "UPDATE run SET meta = json_set(meta, '$.wal_key', ?)").bind(key).run();
}

std::string key_in(sqlite3* db, const std::string& path) {
  Statement key(db, path, "SELECT json_extract(meta, '$.wal_key') FROM run");
  return key.step() ? key.text() : "";
}

// Writes the key into the database file, for readers without access to the WAL.
void checkpoint(sqlite3* db, const std::string& path) {
  if (sqlite3_wal_checkpoint_v2(db, nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr) !=
      SQLITE_OK)
    sqlite_fail(db, path, "cannot bind its -wal");
}

struct BoundKey {
  std::string key;       // empty if the run has no key
  bool records = false;  // true if the run has records
};

// Reads the key from the database file, ignoring its side files. Returns nothing if the file is
// damaged or is not a run.
std::optional<BoundKey> stored_in(const std::string& path) {
  std::error_code none;
  Budget budget = Budget::of_file(std::filesystem::file_size(path, none));
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(immutable_uri(path).c_str(), &db,
                                   SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
  const DatabaseHandle file(db, sqlite3_close);
  if (code != SQLITE_OK) return std::nullopt;
  harden(db);
  limit(db, budget);
  try {
    Statement records(db, path, "SELECT EXISTS(SELECT 1 FROM record)");
    return BoundKey{.key = key_in(db, path), .records = records.step() && records.integer() != 0};
  } catch (const Error&) {  // ignored, because a reader of the run reports the error
    return std::nullopt;
  }
}

[[noreturn]] void refuse(const std::string& path, const std::string& file, const std::string& why) {
  throw Error(ExitCode::failed, printable(path) + ": was not closed, and " + printable(file) +
                                    " belongs to another run (" + why + "); move it away");
}

}  // namespace

std::optional<std::uint32_t> wal_key(const std::string& path) {
  const FileHead header = wal_header(path);
  // SQLite file format, section 4.1. The last bit is set if the checksums are big-endian.
  constexpr std::uint32_t magic = 0x377f0682;
  if ((big_endian(header.data()) & ~1u) != magic) return std::nullopt;
  return big_endian(header.data() + 16) - big_endian(header.data() + 12);
}

bool lacks_wal(const std::string& path) {
  if (wal_header(path) != FileHead{}) return false;
  const auto stored = stored_in(path);
  const bool unbound =
      stored && (stored->key == "none" || (stored->key.empty() && !stored->records));
  return !unbound;
}

// The first write creates the header of the WAL. This write must change the stored key, because
// SQLite does not write an unchanged value. SQLite would choose new salts if the connection's
// checkpoint count were 0, so a TRUNCATE checkpoint increases the count first.
void bind_wal(sqlite3* db, const std::string& path) {
  put_key(db, path, "none");
  const std::string key = text_of(wal_key(path));
  sqlite3_wal_checkpoint_v2(db, nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  put_key(db, path, key);
  checkpoint(db, path);
}

void unbind_wal(sqlite3* db, const std::string& path) {
  try {
    put_key(db, path, "none");
  } catch (const Error&) {  // ignored; on a full disk, the key remains until the run is closed
  }
}

void rebind_wal(sqlite3* db, const std::string& path) {
  const auto found = wal_key(path);
  if (!found || is_own(*found, key_in(db, path))) return;
  put_key(db, path, text_of(found));
  checkpoint(db, path);
}

void require_own_wal(const std::string& path) {
  const auto found = wal_key(path);
  if (!found) return;
  const std::string expected = stored_in(path).value_or(BoundKey{}).key;
  if (!is_own(*found, expected))
    refuse(path, path + "-wal", "key " + text_of(found) + ", expected " + expected);
}

void require_own_journal(const std::string& path) {
  const std::string name = path + "-journal";
  if (::access(name.c_str(), F_OK) != 0) return;
  const auto bytes = RegularFile(name, ExitCode::failed).rest<Bytes>(max_journal_bytes);
  // SQLite file format, section 3
  constexpr std::string_view magic = "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7";
  if (bytes.size() < sizeof(FileHead) ||
      std::string_view(reinterpret_cast<const char*>(bytes.data()), magic.size()) != magic)
    return;
  // A journal has a header of one sector, then the page number, the page and its checksum.
  const std::size_t sector = big_endian(bytes.data() + 20), page = big_endian(bytes.data() + 24);
  if (!lacks_wal(path)) refuse(path, name, "a run with a -wal must not have a -journal");
  if (bytes.size() > sector + page + 8) refuse(path, name, "it has more than one page");
  if (bytes.size() >= sector + 4 && big_endian(bytes.data() + sector) != 1)
    refuse(path, name,
           "it contains a page other than 1: " + std::to_string(big_endian(bytes.data() + sector)));
}

}  // namespace echofuse::record
