// SPDX-License-Identifier: MIT
#include "acquire/record/data_set_part.hpp"

#include <algorithm>

#include "acquire/record/uuid.hpp"
#include "drivers/core/crc32c.hpp"

namespace echofuse::record {

// FNV-1a of 64 bits, CRC-32C, and the length of the text.
std::string data_set_uuid(const RunInfo& info, const std::string& files) {
  const std::string text = info.version + "\n" + info.config_resolved + "\n" + files;
  std::uint64_t mixed = 0xcbf29ce484222325;
  for (const char c : text) mixed = (mixed ^ static_cast<std::uint8_t>(c)) * 0x100000001b3;
  return uuid_text({static_cast<std::uint32_t>(mixed >> 32), static_cast<std::uint32_t>(mixed),
                    crc32c({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}),
                    static_cast<std::uint32_t>(text.size())},
                   8);
}

std::int64_t first_index(const RunReader& run) {
  std::int64_t out = 0;
  run.for_each([&](const FusedRecord& r) { return out = r.index, false; }, 0, {}, {});
  return out;
}

std::optional<std::int64_t> part_of_records(const RunInfo& info) {
  for (const auto& [key, value] : info.meta)
    if (key == part_of_key && !value.empty() && value.size() < 18 &&
        std::all_of(value.begin(), value.end(), [](char c) { return c >= '0' && c <= '9'; }))
      return std::stoll(value);
  return std::nullopt;
}

}  // namespace echofuse::record
