// SPDX-License-Identifier: MIT
// Records of the simulated world: `echofuse-sim dataset` as a child process.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/study/stability_axes.hpp"

namespace echofuse::recon {

class Simulator {
 public:
  // `program`: the simulator; empty: echofuse-sim beside this program, or else from PATH. $TMPDIR
  // or `folder` is for the run files, which are removed once they are read. threads 0: as it likes.
  // `set`: KEY=VALUE of the base condition, before what a world has.
  Simulator(std::string program, std::string folder, int threads,
            std::vector<std::string> set = {});
  // Throws Error(failed) if it does not do it, Error(interrupted).
  BaseCondition base_condition() const;
  Dataset make(const World& world, std::size_t records, std::uint64_t seed) const;

 private:
  Dataset walkers(const World& world, std::size_t records, std::uint64_t seed) const;
  // It makes what the words say, with the list of scenes if there is one.
  Dataset simulate(const std::vector<std::string>& words, const std::string& scenes,
                   std::uint64_t seed) const;
  std::string program_, folder_;
  int threads_;
  std::vector<std::string> set_;
};

}  // namespace echofuse::recon
