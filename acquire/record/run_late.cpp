// SPDX-License-Identifier: MIT
#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

void RunWriter::put_late(std::int64_t first, const LateCounts& late) {
  in_transaction([&] {
    Statement s(db_, path_,
                "INSERT INTO late VALUES (?,?,?,?) ON CONFLICT (idx) DO UPDATE SET"
                " spd = spd + excluded.spd, radar = radar + excluded.radar,"
                " depth = depth + excluded.depth");
    for (const auto& [slot, counts] : late) {
      s.reset();
      s.bind(first + slot);
      for (const std::uint64_t count : counts) s.bind(count);
      s.run();
    }
  });
}

}  // namespace echofuse::record
