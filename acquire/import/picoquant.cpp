// SPDX-License-Identifier: MIT
#include "acquire/import/picoquant.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "acquire/intake/tag_check.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/line_ends.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::size_t chunk_records = 16384;
constexpr std::int64_t block_ps = 10'000'000'000;  // duration of a block: 10 ms
constexpr std::int64_t all = std::numeric_limits<std::uint32_t>::max();
constexpr long double longest_ps = 9.1e18L;  // maximum time of a tag, below 2^63
constexpr long double ps_per_s = 1e12L;
constexpr double rate_share = 0.05;  // tolerated relative difference between pulse rates

// Returns true if `a_s` exceeds `b_s` by more than the tolerated difference between two clocks, 1 %
// + 0.1 s.
bool later(long double a_s, long double b_s) { return a_s > 1.01L * b_s + 0.1L; }

std::string number_text(long double value) { return format("%.5Lg", value); }

}  // namespace

PicoquantRecords::PicoquantRecords(std::uint32_t type, double global_resolution_s,
                                   double resolution_s, double offset)
    : unit_ps_(static_cast<long double>(global_resolution_s) * 1e12L),
      dtime_ps_(static_cast<long double>(resolution_s) * 1e12L) {
  const std::uint32_t kind = type & 0xffffff, mode = type >> 8 & 0xff, device = type & 0xff;
  const bool known = (type >> 24 == 0 || (type >> 24 == 1 && device == 4)) && kind >> 16 == 1 &&
                     (mode == 2 || mode == 3) && device >= 3 && device <= 7;
  if (!known)
    throw Error(ExitCode::failed, "unknown record type " + std::to_string(type) +
                                      " (expected T2 or T3 of PicoHarp, HydraHarp, "
                                      "TimeHarp 260 or MultiHarp)");
  pico_harp_ = device == 3;
  t3_ = mode == 3;
  // The offset is in ns, as in .pt3 and .ht3 files. This also holds for the PicoHarp, although its
  // library uses ps.
  if (t3_ && offset > 0 && offset < 1e9) offset_ps_ = offset * 1000;
  single_overflow_ = pico_harp_ || (device == 4 && type >> 24 == 0);
  wrap_ = pico_harp_         ? (t3_ ? 65536u : 210'698'240u)
          : t3_              ? 1024u
          : single_overflow_ ? 33'552'000u
                             : 33'554'432u;
  const auto possible = [](long double ps) { return ps > 0 && ps <= ps_per_s; };
  if (!possible(unit_ps_) || (t3_ && !possible(dtime_ps_)))
    throw Error(ExitCode::failed,
                "MeasDesc_GlobalResolution or MeasDesc_Resolution is not between 0 and 1 s");
  // Rounds to whole picoseconds, because 1e-12 s and 4e-12 s are not exact as doubles.
  for (long double* v : {&unit_ps_, &dtime_ps_})
    if (std::abs(*v - std::round(*v)) < 1e-9L * *v) *v = std::round(*v);
}

bool PicoquantRecords::add(std::uint32_t record, std::vector<Tag>& out) {
  bool overflow = false, special = false;
  std::uint32_t channel = 0, dtime = 0, unit = 0;
  if (pico_harp_) {
    channel = record >> 28;
    dtime = t3_ ? record >> 16 & 0xfff : 0;
    unit = record & (t3_ ? 0xffffu : 0xfffffffu);
    special = channel == 15;
    overflow = special && (t3_ ? dtime == 0 : (unit & 15) == 0);
  } else {
    channel = record >> 25 & 63;
    dtime = t3_ ? record >> 10 & 0x7fff : 0;
    unit = record & (t3_ ? 0x3ffu : 0x1ffffffu);
    special = record >> 31 == 1;
    overflow = special && channel == 63;
    if (special && channel == 0 && !t3_)
      special = false;  // channel 0 is the sync input
    else if (!special)
      ++channel;
  }
  if (overflow) {
    base_ += wrap_ * (single_overflow_ ? 1 : std::max(unit, 1u));
    return base_ >> 62 == 0 && overflowed_ps() <= longest_ps;
  }
  if (special) {
    ++markers_;
    return true;
  }
  return put(static_cast<std::int32_t>(channel), base_ + unit, dtime, out);
}

bool PicoquantRecords::put(std::int32_t channel, std::uint64_t unit, std::uint64_t dtime,
                           std::vector<Tag>& out) {
  const long double start_ps = static_cast<long double>(unit) * unit_ps_;
  if (!(start_ps <= longest_ps)) return false;
  Tag tag;
  tag.time_ps = std::llround(start_ps);
  if (t3_) {
    tag.channel = sync_channel;
    if (std::exchange(pulse_, unit) != unit) out.push_back(tag);
    const long double after_ps = static_cast<long double>(dtime) * dtime_ps_ + offset_ps_;
    behind_period_ += after_ps > 1.05L * unit_ps_;
    tag.time_ps += std::llround(after_ps);
  }
  tag.channel = channel;
  out.push_back(tag);
  return true;
}

PicoquantTags::PicoquantTags(const std::string& path, const tdc::HistogramSettings& use)
    : file_(path),
      records_([&] {
        const auto type =
            static_cast<std::uint32_t>(file_.whole("TTResultFormat_TTTRRecType", 0, all));
        const double resolution_s = file_.require("MeasDesc_GlobalResolution");
        try {
          return PicoquantRecords(type, resolution_s,
                                  file_.number("MeasDesc_Resolution").value_or(0),
                                  file_.number("MeasDesc_Offset").value_or(0));
        } catch (const Error& e) {
          throw Error(e.code(), printable(path) + ": " + e.what());
        }
      }()),
      use_(use) {
  constexpr double t2 = 2, t3 = 3;
  const double mode = file_.number("Measurement_Mode").value_or(0);
  if (mode == (records_.is_t3() ? t2 : t3))
    throw Error(ExitCode::failed, printable(path) +
                                      ": contradictory header: Measurement_Mode is T" +
                                      number_text(mode) + ", but TTResultFormat_TTTRRecType is T" +
                                      number_text(records_.is_t3() ? t3 : t2));
  const auto length_s = [&](const char* name) {
    return std::clamp(file_.number(name).value_or(0) / 1e3, 0.0, 1e9);
  };
  stopped_s_ = length_s("TTResult_StopAfter");
  header_s_ = std::max(stopped_s_, length_s("MeasDesc_AcquisitionTime"));
}

DeviceInfo PicoquantTags::device() const {
  return {.sensor = Sensor::spd,
          .address = file_.path(),
          .model = file_.text("HW_Type"),
          .serial = file_.text("HW_SerialNo"),
          .firmware = file_.text("HW_FirmwareVersion"),
          .axes = {}};
}

std::optional<UtcTime> PicoquantTags::began() const { return file_.time("File_CreatingTime"); }

bool PicoquantTags::has_ambiguous_start() const { return file_.is_repeated("File_CreatingTime"); }

// Appends the tags of the next record. Returns false at the end of the data.
bool PicoquantTags::read_record() {
  if (in_chunk_ == chunk_.size()) {
    chunk_.resize(chunk_records);
    auto* const begin = reinterpret_cast<std::uint8_t*>(chunk_.data());
    const std::size_t bytes = file_.file().read({begin, chunk_records * sizeof chunk_[0]});
    if (count_ == 0 && has_added_returns({begin, bytes}))
      throw Error(ExitCode::failed, printable(file_.path()) + ": " + added_returns);
    bytes_cut_ += bytes % sizeof chunk_[0];
    chunk_.resize(bytes / sizeof chunk_[0]);
    in_chunk_ = 0;
    if (chunk_.empty()) return false;
  }
  const std::size_t before = tags_.size();
  beyond_ = !records_.add(chunk_[in_chunk_++], tags_);
  ++count_;
  for (std::size_t i = before; i < tags_.size(); ++i) {
    ++by_channel_[static_cast<std::size_t>(tags_[i].channel)];
    if (tags_[i].channel != sync_channel) continue;
    if (first_sync_ps_ < 0) first_sync_ps_ = tags_[i].time_ps;
    last_sync_ps_ = std::max(last_sync_ps_, tags_[i].time_ps);
  }
  if (before < tags_.size()) {
    last_ps_ = std::max(last_ps_, static_cast<long double>(tags_.back().time_ps));
    if (header_s_ > 0 && later(last_ps_ / ps_per_s, header_s_)) tags_.resize(before);
  }
  return !beyond_;
}

bool PicoquantTags::next(SampleSink& sink) {
  std::size_t known = tags_.size();
  const auto block_of = [](const Tag& tag) { return tag.time_ps / block_ps; };
  bool more = true;
  constexpr std::size_t max_tags = std::size_t{1} << 20;  // maximum number of tags per block
  while (more && known < max_tags &&
         (known == 0 || block_of(tags_.back()) <= block_of(tags_.front()))) {
    known = tags_.size();
    more = read_record();
  }
  if (!more) known = tags_.size();
  if (known == 0) {
    if (beyond_) return false;
    // A recording made in the dark may end with overflow records. The last overflow record then
    // defines the end time.
    const auto end_s = static_cast<double>(end_ps() / ps_per_s);
    at_ = std::max(at_, from_seconds(header_s_ > 0 ? std::min(end_s, header_s_) : end_s) -
                            std::chrono::nanoseconds(1));
    return false;
  }
  std::int64_t last_ps = 0;
  for (std::size_t i = 0; i < known; ++i) last_ps = std::max(last_ps, tags_[i].time_ps);
  // Keeps block times from decreasing if an out-of-order tag is earlier than the previous block.
  at_ = std::max(at_, HostTime(last_ps / 1000));
  TagBlock block;
  block.received = at_;
  block.tags = std::span(tags_).first(known);
  sink.on_tags(block);
  tags_.erase(tags_.begin(), tags_.begin() + static_cast<std::ptrdiff_t>(known));
  return true;
}

std::vector<Counter> PicoquantTags::counters() const {
  return {{"records", count_}, {"markers", records_.markers()}};
}

// Returns a warning that lists the inputs with events if a selected input has no events; otherwise
// an empty string.
std::string PicoquantTags::missing_input() const {
  const auto has = [&](std::int32_t c) {
    return c >= 0 && c < std::ssize(by_channel_) && by_channel_[static_cast<std::size_t>(c)] > 0;
  };
  if (has(use_.start_channel) && has(use_.click_channel)) return "";
  std::vector<std::string> there;
  for (std::int32_t c = 0; c < std::ssize(by_channel_); ++c)
    if (has(c)) there.push_back(std::to_string(c));
  std::string text = "no events on the input selected by " +
                     (has(use_.start_channel) ? "--click " + std::to_string(use_.click_channel)
                                              : "--start " + std::to_string(use_.start_channel));
  for (const auto& c : there) text += (&c == there.data() ? "; inputs with events: " : ", ") + c;
  return there.size() < 2
             ? text
             : text + "; did you mean --start " + there[0] + " --click " + there[1] + "?";
}

// Returns a warning if the pulse rate in the header contradicts the time resolution or the records.
std::vector<std::string> PicoquantTags::rate_doubts() const {
  const double rate_hz = file_.number("TTResult_SyncRate").value_or(0);
  if (rate_hz <= 0) return {};
  const auto unit_s = static_cast<double>(records_.unit_ps() / ps_per_s);
  const double divider = std::max(1.0, file_.number("HWSync_Divider").value_or(1));
  const double share = rate_hz * unit_s;  // time step in pulse periods; 1 in T3 mode
  const auto similar = [&](double value, double expected) {
    return std::abs(value / expected - 1) <= rate_share;
  };
  if (records_.is_t3()
          ? !similar(share, 1) && !similar(share, divider) && !similar(share, 1 / divider)
          : share > rate_share)
    return {"TTResult_SyncRate is " + number_text(rate_hz) +
            " Hz, but MeasDesc_GlobalResolution is " + number_text(unit_s) + " s"};
  const std::uint64_t pulses = by_channel_[sync_channel];
  if (records_.is_t3() || pulses < 100 || last_sync_ps_ <= first_sync_ps_) return {};
  const auto between_s = static_cast<double>((last_sync_ps_ - first_sync_ps_) / ps_per_s);
  const double counted_hz = static_cast<double>(pulses - 1) / between_s;
  if (similar(counted_hz, rate_hz) || similar(counted_hz, rate_hz / divider)) return {};
  return {"pulse rate: TTResult_SyncRate is " + number_text(rate_hz) +
          " Hz, but the pulse rate in the records is " + number_text(counted_hz) + " Hz"};
}

std::vector<std::string> PicoquantTags::doubts() const {
  std::vector<std::string> out;
  if (const std::string text = missing_input(); !text.empty()) out.push_back(text);
  const auto end_s = static_cast<double>(end_ps() / ps_per_s);
  const bool behind = header_s_ > 0 && later(end_s, header_s_);
  const double stated_s = stopped_s_ > 0 ? stopped_s_ : header_s_;
  if (behind || (stopped_s_ > 0 && (later(end_s, stopped_s_) ||
                                    later(stopped_s_, end_s + records_.wrap_ps() / ps_per_s))))
    out.push_back("duration: " + number_text(stated_s) + " s in the header, " + number_text(end_s) +
                  " s in the records" +
                  (behind ? ": records after the end time in the header are omitted; check whether "
                            "a record is damaged"
                          : ""));
  for (auto& text : rate_doubts()) out.push_back(std::move(text));
  if (records_.offset_ps() > 0)
    out.push_back("MeasDesc_Offset: the device subtracted " +
                  number_text(records_.offset_ps() / 1000) +
                  " ns from the click times; this offset is added back");
  if (records_.behind_period() > 0)
    out.push_back(std::to_string(records_.behind_period()) +
                  " clicks have times beyond the sync period of " +
                  number_text(records_.unit_ps() / ps_per_s) + " s; check MeasDesc_Resolution");
  if (const std::string text = comb_text(records_.step_ps(), use_.bin_width_ps); !text.empty())
    out.push_back(text);
  const double stated = file_.number("TTResult_NumberOfRecords").value_or(0);
  if (stated > 0 && stated != static_cast<double>(count_))
    out.push_back("the header specifies " + std::to_string(std::llround(stated)) +
                  " records, but the file contains " + std::to_string(count_));
  if (bytes_cut_ > 0) out.push_back("the last record is truncated");
  if (beyond_) out.push_back("the time exceeds 106 days: the remaining records are omitted");
  const double divider = file_.number("HWSync_Divider").value_or(1);
  if (divider > 1 && !records_.is_t3())
    out.push_back("sync divider " + std::to_string(std::llround(divider)) +
                  ": the file contains only the corresponding fraction of the laser pulses");
  std::string inputs;
  for (std::size_t c = 0; c < by_channel_.size(); ++c)
    if (by_channel_[c] > 0)
      inputs += (inputs.empty() ? "" : ", ") + std::to_string(c) + (c == 0 ? " (sync) " : " ") +
                std::to_string(by_channel_[c]);
  out.push_back("events by input: " + (inputs.empty() ? "none" : inputs));
  return out;
}

}  // namespace echofuse::acquire
