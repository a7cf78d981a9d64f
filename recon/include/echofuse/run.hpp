// SPDX-License-Identifier: MIT
/// @file
/// Run file: opens a finished, live or crashed run, and follows one that is being recorded.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "echofuse/record.hpp"

namespace echofuse {

/// Facts that a run states about itself.
struct RunFacts {
  std::string uuid;         ///< identity of the run, whatever its file is called
  std::string started_utc;  ///< ISO 8601
  std::string ended_utc;    ///< ISO 8601; empty unless the run is closed
  std::string status;       ///< `open`, `complete`, `crashed`, or `stopped:` and the reason
  std::string notes;        ///< text of the operator; may be empty
  double window_s = 0;      ///< length of a slot, s
  std::vector<std::pair<std::string, std::string>> meta;  ///< names and values of `run --meta`
};

/// Called with the number of a damaged record and its fault.
using OnDamaged = std::function<void(std::int64_t, const std::string&)>;

/// A run file, read only. Every member throws std::runtime_error with one line that names the file
/// and the fault. Threading: one thread at a time; each thread may open the file for itself.
class Run {
 public:
  /// Opens the run at `path`; the ending `.sqlite` may be left out. Throws if the file is missing,
  /// damaged, or no run of this version's format.
  explicit Run(const std::string& path);

  /// Returns the path as it was given.
  const std::string& path() const;
  /// Returns the facts that the run states about itself.
  RunFacts facts() const;
  /// Returns the number of records, which grows while the run is recorded.
  std::int64_t count() const;
  /// Returns the axis of this name: `spd`, `radar`, `depth_x` or `depth_y`; empty if the run has no
  /// such values.
  std::optional<RunAxis> axis(const std::string& name) const;
  /// Returns the number of the detector's histograms in a record: 1 for a single pixel.
  std::size_t zones() const;
  /// Returns the grid of the run's depth maps.
  MapGrid grid() const;

  /// Returns the record with this number. Throws if it does not exist or is damaged.
  Record read(std::int64_t index) const;
  /// Calls `visit` with each record from number `first` on, in order, until it returns false. Calls
  /// `on_damaged` instead for a damaged record and goes on; without it, throws.
  void for_each(const std::function<bool(const Record&)>& visit, std::int64_t first = 0,
                const OnDamaged& on_damaged = {}) const;

 private:
  friend struct Internals;
  struct File;
  explicit Run(std::shared_ptr<const File> file) : file_(std::move(file)) {}
  std::shared_ptr<const File> file_;
};

/// Calls `visit` with each record of a run that is being recorded, from number `first` on, as they
/// come. Returns when the run is closed, `visit` returns false, or `go_on`, called at least every
/// 20 ms between records, returns false. The run is opened again for each poll, so that the
/// recorder can close it; a Run must not be kept after `visit`. `on_damaged`: as in Run::for_each.
/// Throws as Run does.
void follow(const std::string& path, const std::function<bool(const Run&, const Record&)>& visit,
            std::int64_t first = 0, const std::function<bool()>& go_on = {},
            const OnDamaged& on_damaged = {});

}  // namespace echofuse
