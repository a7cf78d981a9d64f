// SPDX-License-Identifier: MIT
#include "recon/models/checkpoint.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <sstream>

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {
namespace {

std::vector<std::string> lines_of(const CheckpointOptions& options) {
  std::vector<std::string> out;
  for (const auto& [name, value] : options.settings) out.push_back(name + "=" + value);
  return out;
}

void check_settings(const std::vector<std::string>& found, const CheckpointOptions& options) {
  const auto wanted = lines_of(options);
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (i >= found.size() || found[i] != wanted[i])
      throw Error(ExitCode::config,
                  options.path + ": belongs to a training with " +
                      (i < found.size() ? found[i] : "fewer settings") + ", this one has " +
                      wanted[i] + "; repeat its options, or leave --resume out to begin anew");
}

std::int64_t integer(std::size_t n) { return static_cast<std::int64_t>(n); }

// False with errno. A file system that cannot do it in one step does it in two.
bool rename_to(const std::string& from, const std::string& to, Existing existing) {
  if (existing == Existing::replace) return std::rename(from.c_str(), to.c_str()) == 0;
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  if (::access(to.c_str(), F_OK) == 0) return errno = EEXIST, false;
  return std::rename(from.c_str(), to.c_str()) == 0;
}

}  // namespace

void write_whole(const std::string& path, Existing existing,
                 const std::function<void(record::H5File&)>& fill) {
  const std::string unfinished = path + ".part";
  std::remove(unfinished.c_str());
  record::H5File file = record::H5File::create_sealed(unfinished);
  fill(file);
  file.close();
  if (rename_to(unfinished, path, existing)) return;
  const bool there = errno == EEXIST;
  throw Error(there ? ExitCode::failed : ExitCode::disk,
              path +
                  (there ? ": was made by somebody else meanwhile; what was to be there is in "
                         : ": cannot rename to it ") +
                  unfinished);
}

Checkpoints::Checkpoints(const CheckpointOptions& options) : options_(options) {}

void Checkpoints::save_if_due(const TrainingState& state) {
  if (std::chrono::duration<double>(Clock::now() - saved_).count() >= options_.every_s) save(state);
}

void Checkpoints::save(const TrainingState& s) {
  if (options_.path.empty()) return;
  const double spent = std::chrono::duration<double>(Clock::now() - started_).count();
  std::ostringstream rng;
  rng << s.order_rng;
  write_whole(options_.path, Existing::replace, [&](record::H5File& file) {
    file.write_texts("settings", lines_of(options_));
    const auto flat = [&](const char* name, const auto& v) { file.write(name, v, {v.size()}); };
    flat("parameters", s.parameters);
    flat("best", s.best);
    flat("adam/first", s.adam.first);
    flat("adam/second", s.adam.second);
    file.set("adam", "steps", integer(s.adam.steps));
    flat("order", std::vector<std::uint64_t>(s.order.begin(), s.order.end()));
    file.write_text("rng", rng.str());
    flat("log/loss_m", s.log.loss);
    flat("log/validation_loss_m", s.log.validation_loss);
    file.set("log", "best_epoch", integer(s.log.best_epoch));
    file.set("log", "least", s.least);
    file.set("log", "epoch", integer(s.epoch));
    file.set("log", "row", integer(s.row));
    file.set("log", "squares", s.squares);
    file.set("log", "s", earlier_s_ + spent);
  });
  saved_ = Clock::now();
}

void Checkpoints::resume(TrainingState& s) {
  if (!options_.resume) return;
  if (::access(options_.path.c_str(), R_OK) != 0)
    throw Error(ExitCode::failed, options_.path + ": no such file: no training was stopped here");
  const record::H5File file = record::H5File::open_sealed(options_.path);
  check_settings(file.read_texts("settings"), options_);
  const auto count = [&](const char* name) {
    return static_cast<std::size_t>(file.get<std::int64_t>("log", name));
  };
  const record::H5Shape weights{s.parameters.size()};
  s.parameters = file.read<float>("parameters", weights);
  s.best = file.read<float>("best", weights);
  s.adam.first = file.read<float>("adam/first", weights);
  s.adam.second = file.read<float>("adam/second", weights);
  s.adam.steps = static_cast<std::size_t>(file.get<std::int64_t>("adam", "steps"));
  const auto order = file.read<std::uint64_t>("order", {s.order.size()});
  require_sound(file, std::is_permutation(order.begin(), order.end(), s.order.begin()), "order",
                "the training records in any order");
  s.order.assign(order.begin(), order.end());
  std::istringstream rng(file.read_text("rng"));
  require_sound(file, static_cast<bool>(rng >> s.order_rng), "rng", "a generator's state");
  s.log.loss = file.read<double>("log/loss_m", {count("epoch")});
  s.log.validation_loss = file.read<double>("log/validation_loss_m", {count("epoch")});
  s.log.best_epoch = count("best_epoch");
  s.least = file.get<double>("log", "least");
  s.epoch = count("epoch");
  s.row = count("row");
  require_sound(file, s.row <= s.order.size(), "log@row", "at most the number of training records");
  require_sound(file, s.log.best_epoch <= s.epoch, "log@best_epoch", "no later one than log@epoch");
  s.squares = file.get<double>("log", "squares");
  earlier_s_ = file.get<double>("log", "s");
}

}  // namespace echofuse::recon
