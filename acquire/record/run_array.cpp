// SPDX-License-Identifier: MIT
// The radar's virtual antennas in a run file.
#include <cmath>

#include "acquire/record/insert.hpp"
#include "acquire/record/run_file.hpp"

namespace echofuse::record {

void RunWriter::put_antennas(const Antennas& antennas) {
  in_transaction([&] {
    execute(db_, path_, "DELETE FROM antenna", "cannot store the antennas");
    for (std::size_t i = 0; i < antennas.size(); ++i)
      rows_->into("antenna")
          .set("antenna", static_cast<std::int64_t>(i))
          .set("x", antennas[i].x)
          .set("y", antennas[i].y)
          .set("gain", antennas[i].gain)
          .set("phase_rad", antennas[i].phase_rad)
          .run();
  });
}

Antennas RunReader::antennas() const {
  Antennas out;
  if (!has_table("antenna")) return out;
  Statement s = ask("SELECT x, y, gain, phase_rad FROM antenna ORDER BY antenna");
  while (s.step()) {
    Antenna a;
    for (double* v : {&a.x, &a.y, &a.gain, &a.phase_rad}) *v = s.real();
    const bool sound = std::abs(a.x) < 1e3 && std::abs(a.y) < 1e3 && a.gain >= 1e-3 &&
                       a.gain <= 1e3 && std::abs(a.phase_rad) < 1e3;
    if (!sound || out.size() == most_antennas)
      throw Error(ExitCode::failed, shown_ + ": damaged: antenna " + std::to_string(out.size()) +
                                        " is none; expected at most 12 with place, gain and phase");
    out.push_back(a);
  }
  const auto array = axis("array");
  if (array && !out.empty() && out.size() != antennas_of(*array))
    throw Error(ExitCode::failed, shown_ + ": damaged: " + std::to_string(out.size()) +
                                      " antennas, its array axis is of " +
                                      std::to_string(antennas_of(*array)));
  return out;
}

}  // namespace echofuse::record
