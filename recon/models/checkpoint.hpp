// SPDX-License-Identifier: MIT
// An unfinished training on file, from which it goes on as if it had never stopped: every bit of
// what the next step depends on, and the settings that it may only go on with.
//
//   /settings    texts "name=value"
//   /parameters, best, adam/first, adam/second (attribute steps), order, rng (text)
//   /log/loss_m, validation_loss_m; attributes of /log: best_epoch, least, epoch, row, squares, s
#pragma once
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/models/model.hpp"
#include "recon/models/network/adam.hpp"

namespace echofuse::recon {

struct TrainingState {
  std::vector<float> parameters, best;  // now, and of the best epoch
  Adam adam;
  Rows order;  // of the records in this epoch
  Rng order_rng;
  TrainingLog log;
  double least;                    // validation loss of the best epoch
  std::size_t epoch = 0, row = 0;  // done: whole epochs, and records of this one
  double squares = 0;              // sum of squared errors of those records
};

// Writes a new sealed file beside and renames it: what fails leaves the old one. Throws
// Error(disk), and Error(failed) if there is one that is not to be replaced: then the new one is
// kept as PATH.part.
enum class Existing : bool { keep, replace };
void write_whole(const std::string& path, Existing existing,
                 const std::function<void(record::H5File&)>& fill);

// Nothing happens without a path.
class Checkpoints {
 public:
  explicit Checkpoints(const CheckpointOptions& options);
  // Replaces the state by the one on file if that is wanted. Throws Error(config) if its
  // settings are others, Error(failed) if there is no such file or it is not one.
  void resume(TrainingState& state);
  void save(const TrainingState& state);
  void save_if_due(const TrainingState& state);
  double earlier_s() const { return earlier_s_; }  // spent before the training was resumed

 private:
  using Clock = std::chrono::steady_clock;
  const CheckpointOptions& options_;
  Clock::time_point started_ = Clock::now(), saved_ = started_;
  double earlier_s_ = 0;
};

}  // namespace echofuse::recon
