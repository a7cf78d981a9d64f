// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>

#include "acquire/import/import.hpp"
#include "acquire/import/imported_run.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t max_bytes = 64 << 20;  // largest block that a port delivers, in bytes
// Limits of the time since the machine was started (36 years) and of UTC (year 2116). Sums and
// differences of such times fit into 64 bits.
constexpr std::int64_t longest_ns = std::int64_t{1} << 60, max_value = std::int64_t{1} << 62;
constexpr std::chrono::hours longest_pause{2};  // longest plausible time between two closed slots

// Reads the file NAME.times in the folder line by line. Ignores a truncated last line.
class TimesFile {
 public:
  struct Line {
    HostTime at;
    std::string what;
    std::int64_t value;
  };
  TimesFile(const std::string& folder, const std::string& name)
      : path_(folder + "/" + name + ".times") {
    require_regular(path_, ExitCode::failed);
    in_.open(path_);
  }
  const std::string& path() const { return path_; }
  std::optional<Line> next() {
    std::string text;
    if (!std::getline(in_, text) || in_.eof()) return std::nullopt;
    std::int64_t at_ns = 0, value = 0;
    char what[16];
    if (std::sscanf(text.c_str(), "%" SCNd64 " %15s %" SCNd64, &at_ns, what, &value) == 3 &&
        at_ns >= 0 && at_ns <= longest_ns && value >= -max_value && value <= max_value)
      return Line{HostTime(at_ns), what, value};
    throw Error(ExitCode::failed, printable(path_) + ": expected TIME WHAT VALUE, found \"" +
                                      printable(text, 80) + "\"");
  }

 private:
  std::string path_;
  std::ifstream in_;
};

class CapturedPort {
 public:
  CapturedPort(port::Loop& l, std::string folder, const std::string& name, std::string ending)
      : loop(l),
        times_(folder, name),
        stem_(std::move(folder) + "/" + name),
        ending_(std::move(ending)) {
    while (const auto line = times_.next()) lines_.push_back(*line);
  }
  void connect() {
    while (!lines_.empty() && lines_.front().what != "open") lines_.pop_front();
    if (!lines_.empty()) lines_.pop_front();
    const auto end = std::ranges::find(lines_, "open", &TimesFile::Line::what);
    accepted_ = end == lines_.end() || (end != lines_.begin() && std::prev(end)->what == "gone");
    file_.reset();
  }
  // Returns true unless the driver of the captured run closed the connection itself, e.g. because
  // of a damaged block.
  bool accepted() const { return accepted_; }
  // Returns the next line of the connection; no value at its end.
  std::optional<TimesFile::Line> next() {
    if (lines_.empty() || lines_.front().what == "open") return std::nullopt;
    auto line = std::move(lines_.front());
    lines_.pop_front();
    return line;
  }
  Bytes read(std::int64_t count) {
    if (!file_) name_ = stem_ + format("-%03d", ++files_) + ending_;
    if (!file_) file_.emplace(name_, ExitCode::failed);
    Bytes out(count > 0 && count <= max_bytes ? static_cast<std::size_t>(count) : 0);
    if (out.empty() || file_->read(out) != out.size())
      throw Error(ExitCode::failed, printable(times_.path()) + ": lists more bytes than " +
                                        printable(fs::path(name_).filename().string()) +
                                        " contains; one of the files is truncated or damaged");
    return out;
  }
  port::Loop& loop;

 private:
  TimesFile times_;
  std::string stem_, ending_, name_;
  std::deque<TimesFile::Line> lines_;  // lines that have not been replayed
  bool accepted_ = false;
  // File with the bytes of the connection; opened by the first read.
  std::optional<RegularFile> file_;
  int files_ = 0;
};

class KeptPort final : public port::BytePort {
 public:
  explicit KeptPort(CapturedPort& stream)
      : link_(new PortState{stream, port::Timer(stream.loop), {}, false}) {}
  ~KeptPort() override {
    link_->closed = true;
    link_->timer.cancel();
  }
  KeptPort(const KeptPort&) = delete;
  KeptPort& operator=(const KeptPort&) = delete;

  void open(port::PortHandlers handlers) override {
    link_->handlers = std::move(handlers);
    link_->stream.connect();
    wait(link_);
  }
  void write(ByteView) override {}
  bool recorded() const override { return link_->stream.accepted(); }

 private:
  // State that remains valid if the port is destroyed while a handler runs.
  struct PortState {
    CapturedPort& stream;
    port::Timer timer;
    port::PortHandlers handlers;
    bool closed;
  };
  static void wait(const std::shared_ptr<PortState>& link) {
    const auto line = link->stream.next();
    if (!line) return;
    link->timer.at(line->at, [link, what = line->what, value = line->value] {
      const auto held = link;
      if (what == "opened") held->handlers.opened();
      if (what == "bytes") held->handlers.bytes(held->stream.read(value));
      if (what == "gone")
        held->handlers.gone(
            {std::error_code(static_cast<int>(value), std::generic_category()), "as kept"});
      if (!held->closed) wait(held);
    });
  }
  std::shared_ptr<PortState> link_;
};

// Times of the captured run: start of the run, start of the first slot, closing of each slot, and
// UTC minus host time. `closings` ends before the first time that is missing or not plausible.
struct LiveRun {
  std::optional<HostTime> started, first_slot;
  UtcTime utc_offset{};
  std::int64_t slots = 0, slot_ns = 0;
  std::deque<ClosedSlot> closings;
};

LiveRun read_live_run(const std::string& folder) {
  TimesFile times(folder, "run");
  LiveRun run;
  HostTime ended{};
  while (const auto line = times.next()) {
    if (line->what == "start")
      run.started = line->at, run.utc_offset = UtcTime(line->value) - line->at;
    if (line->what == "slots") run.first_slot = line->at, run.slot_ns = line->value;
    if (line->what != "closed" && line->what != "stalled") continue;
    const HostTime last =
        run.closings.empty() ? run.first_slot.value_or(line->at) : run.closings.back().at;
    if (line->value == run.slots && std::cmp_equal(run.closings.size(), run.slots) &&
        line->at >= last && line->at <= last + longest_pause)
      run.closings.push_back({line->at, line->what == "stalled"});
    ++run.slots, ended = std::max(ended, line->at);
  }
  if (!run.started || !run.first_slot || run.slots == 0)
    throw Error(ExitCode::failed,
                printable(times.path()) + ": the raw capture has no complete slot");
  // A corrupted number must not cause an unlimited number of slots, or a wait of years before slot
  // 0.
  const double slot_s = seconds(HostTime(run.slot_ns)), lasted_s = seconds(ended - *run.first_slot),
               wait_s = seconds(*run.first_slot - *run.started);
  constexpr double shortest_s = 0.05, longest_s = 3600;  // limits of the setting `run.window_s`
  constexpr double longest_wait_s =
      // Sum of the limits of `run.connect_timeout_s` and `--countdown`, plus a margin.
      3 * 3600;
  if (!(wait_s >= 0 && wait_s <= longest_wait_s))
    throw Error(
        ExitCode::failed,
        printable(times.path()) + ": the first slot begins " + std::to_string(wait_s) +
            " s after the start of the run (expected 0 to 3 h); check whether a number is damaged");
  if (!(slot_s >= shortest_s && slot_s <= longest_s) ||
      static_cast<double>(run.slots) * slot_s > lasted_s + slot_s)
    throw Error(ExitCode::failed, printable(times.path()) + ": lists " + std::to_string(run.slots) +
                                      " slots of " + std::to_string(slot_s) + " s in " +
                                      std::to_string(lasted_s) +
                                      " s; check whether a number is damaged");
  return run;
}

}  // namespace

bool is_kept(const std::string& folder) { return fs::exists(fs::path(folder) / "run.times"); }

Config kept_config(const std::string& folder, const std::vector<std::string>& assignments) {
  const bool calibrated = fs::exists(fs::path(folder) / "calibration.toml");
  std::vector<std::string> all{
      "run.folder=", "radar.cfg=radar.cfg",
      std::string("run.calibration=") + (calibrated ? "calibration.toml" : "")};
  all.insert(all.end(), assignments.begin(), assignments.end());
  return load_config(folder + "/lab.toml", all);
}

std::string import_kept(Config config, const std::string& folder, const std::string& out) {
  const LiveRun live = read_live_run(folder);
  port::VirtualLoop loop(live.utc_offset, *live.started);
  std::vector<std::unique_ptr<CapturedPort>> streams;
  const auto attach = [&](std::string& address, const char* name, const char* ending) {
    if (!fs::exists(fs::path(folder) / (std::string(name) + ".times"))) address.clear();
    if (address.empty()) return;
    CapturedPort* stream =
        streams.emplace_back(std::make_unique<CapturedPort>(loop, folder, name, ending)).get();
    loop.ports[address] = [stream] { return std::make_unique<KeptPort>(*stream); };
  };
  // Frames of an OpenNI2 camera are stored in the format of the bridge protocol.
  if (config.depth.address.starts_with("openni:")) config.depth.address = "bridge:tcp://kept:1";
  attach(config.tdc.address, "tags", ".blocks");
  attach(config.radar.address, "radar", ".blocks");
  attach(config.radar.cli, "radar-cli", ".txt");
  attach(config.radar.data, "radar", ".dat");
  attach(config.depth.address, "depth", ".blocks");
  if (config.radar.cli.empty() != config.radar.data.empty())
    throw Error(ExitCode::failed, printable(folder) +
                                      ": contains only one of radar.times and "
                                      "radar-cli.times; the capture is incomplete");
  if (streams.empty())
    throw Error(ExitCode::failed, printable(folder) + ": contains no data of a configured device");
  refuse_bad_target(out);
  NewFile file(out, NewFile::Staged{});
  RunOptions options;
  options.count =
      std::max<std::int64_t>(1, live.slots * live.slot_ns / from_seconds(config.window_s).count());
  options.meta = {{"imported_from", utf8_text(fs::path(folder).filename().string())}};
  options.kept_slot = live.first_slot;
  if (live.slot_ns == from_seconds(config.window_s).count()) options.kept_closings = live.closings;
  record_import(std::move(config), std::move(options), loop, file);
  return publish_import(file);
}

}  // namespace echofuse::acquire
