// SPDX-License-Identifier: MIT
#include "acquire/import/picoquant.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "acquire/import/tagged_file.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::size_t chunk_records = 16384;
constexpr std::int64_t block_ps = 10'000'000'000;  // divides every slot's length in ms
constexpr std::int64_t all = std::numeric_limits<std::uint32_t>::max();

DeviceInfo device_of(const TaggedFile& file) {
  return {.sensor = Sensor::spd,
          .address = file.path(),
          .model = file.text("HW_Type"),
          .serial = file.text("HW_SerialNo"),
          .firmware = file.text("HW_FirmwareVersion"),
          .axes = {}};
}

}  // namespace

PicoquantRecords::PicoquantRecords(std::uint32_t type, double global_resolution_s,
                                   double resolution_s)
    : unit_ps_(static_cast<long double>(global_resolution_s) * 1e12L),
      dtime_ps_(static_cast<long double>(resolution_s) * 1e12L) {
  const std::uint32_t kind = type & 0xffffff, mode = type >> 8 & 0xff, device = type & 0xff;
  const bool known = (type >> 24 == 0 || (type >> 24 == 1 && device == 4)) && kind >> 16 == 1 &&
                     (mode == 2 || mode == 3) && device >= 3 && device <= 7;
  if (!known)
    throw Error(ExitCode::failed, "records of the type " + std::to_string(type) +
                                      ", which is none of T2 and T3 of PicoHarp, HydraHarp, "
                                      "TimeHarp 260 and MultiHarp");
  pico_harp_ = device == 3;
  t3_ = mode == 3;
  once_ = pico_harp_ || (device == 4 && type >> 24 == 0);
  wrap_ = pico_harp_ ? (t3_ ? 65536u : 210'698'240u)
          : t3_      ? 1024u
          : once_    ? 33'552'000u
                     : 33'554'432u;
  constexpr long double longest_ps = 1e12L;
  const auto possible = [](long double ps) { return ps > 0 && ps <= longest_ps; };
  if (!possible(unit_ps_) || (t3_ && !possible(dtime_ps_)))
    throw Error(ExitCode::failed, "no resolution between 0 and 1 s");
  // Written as 1e-12 or 4e-12, a double is not quite whole picoseconds.
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
      special = false;  // the sync
    else if (!special)
      ++channel;
  }
  if (overflow) {
    base_ += wrap_ * (once_ ? 1 : std::max(unit, 1u));
    return true;
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
  if (!(start_ps <= 9.1e18L)) return false;
  Tag tag;
  tag.time_ps = std::llround(start_ps);
  if (t3_) {
    tag.channel = sync_channel;
    if (std::exchange(pulse_, unit) != unit) out.push_back(tag);
    tag.time_ps += std::llround(static_cast<long double>(dtime) * dtime_ps_);
  }
  tag.channel = channel;
  out.push_back(tag);
  return true;
}

struct PicoquantTags::File : TaggedFile {
  using TaggedFile::TaggedFile;
};

PicoquantTags::PicoquantTags(const std::string& path)
    : file_(std::make_unique<File>(path, "PQTTTR")), records_([&] {
        try {
          return PicoquantRecords(
              static_cast<std::uint32_t>(file_->whole("TTResultFormat_TTTRRecType", 0, all)),
              file_->require("MeasDesc_GlobalResolution"),
              file_->number("MeasDesc_Resolution").value_or(0));
        } catch (const Error& e) {
          throw Error(e.code(), printable(path) + ": " + e.what());
        }
      }()) {}

PicoquantTags::~PicoquantTags() = default;

DeviceInfo PicoquantTags::device() const { return device_of(*file_); }

std::optional<UtcTime> PicoquantTags::began() const { return file_->time("File_CreatingTime"); }

// Behind the last tags; false at the end.
bool PicoquantTags::read_record() {
  if (in_chunk_ == chunk_.size()) {
    chunk_.resize(chunk_records);
    const std::size_t bytes = file_->file().read(
        {reinterpret_cast<std::uint8_t*>(chunk_.data()), chunk_records * sizeof chunk_[0]});
    bytes_cut_ = bytes % sizeof chunk_[0];
    chunk_.resize(bytes / sizeof chunk_[0]);
    in_chunk_ = 0;
    if (chunk_.empty()) return false;
  }
  const std::size_t before = tags_.size();
  beyond_ = !records_.add(chunk_[in_chunk_++], tags_);
  ++count_;
  for (std::size_t i = before; i < tags_.size(); ++i)
    ++by_channel_[static_cast<std::size_t>(tags_[i].channel)];
  return !beyond_;
}

bool PicoquantTags::next(SampleSink& sink) {
  std::size_t known = tags_.size();  // 0, or what the last block left
  const auto block_of = [](const Tag& tag) { return tag.time_ps / block_ps; };
  bool more = true;
  constexpr std::size_t most_tags = std::size_t{1} << 20;  // in a block
  while (more && known < most_tags &&
         (known == 0 || block_of(tags_.back()) <= block_of(tags_.front()))) {
    known = tags_.size();
    more = read_record();
  }
  if (!more) known = tags_.size();
  if (known == 0) return false;
  std::int64_t last_ps = 0;
  for (std::size_t i = 0; i < known; ++i) last_ps = std::max(last_ps, tags_[i].time_ps);
  // Never back: a tag out of order stays with its neighbours.
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

std::vector<std::string> PicoquantTags::doubts() const {
  std::vector<std::string> out;
  const double told = file_->number("TTResult_NumberOfRecords").value_or(0);
  if (told > 0 && told != static_cast<double>(count_))
    out.push_back("its header tells of " + std::to_string(std::llround(told)) +
                  " records, it has " + std::to_string(count_));
  if (bytes_cut_ > 0) out.push_back("its last record is cut");
  if (beyond_) out.push_back("a time beyond 106 days: what follows is left out");
  if (const double divider = file_->number("HWSync_Divider").value_or(1);
      divider > 1 && !records_.is_t3())
    out.push_back("its sync was divided by " + std::to_string(std::llround(divider)) +
                  ": only so many of the laser's pulses are in it");
  std::string inputs;
  for (std::size_t c = 0; c < by_channel_.size(); ++c)
    if (by_channel_[c] > 0)
      inputs += (inputs.empty() ? "" : ", ") + std::to_string(c) + (c == 0 ? " (sync) " : " ") +
                std::to_string(by_channel_[c]);
  out.push_back("events by input: " + (inputs.empty() ? "none" : inputs));
  return out;
}

PicoquantHistograms read_histograms(const std::string& path) {
  const TaggedFile file(path, "PQHISTO");
  const Bytes data = file.file().rest<Bytes>();
  const auto refuse = [&](const std::string& why) {
    throw Error(ExitCode::failed, printable(path) + ": " + why);
  };
  constexpr std::int64_t most_curves = 100'000, most_bins = 1 << 24;
  PicoquantHistograms out{.device = device_of(file), .curves = {}};
  const auto curves =
      static_cast<std::int32_t>(file.whole("HistoResult_NumberOfCurves", 1, most_curves));
  const double step_s = file.require("HistResDscr_MDescResolution", 0);
  if (!(step_s >= 1e-15 && step_s <= 1)) refuse("its resolution is not between 1 fs and 1 s");
  std::size_t used = 1;
  for (std::int32_t i = 0; i < curves; ++i) {
    const auto bins =
        static_cast<std::size_t>(file.whole("HistResDscr_HistogramBins", 1, most_bins, i));
    const auto place =
        static_cast<std::size_t>(file.whole("HistResDscr_DataOffset", 0, std::int64_t{1} << 52, i));
    if (place < file.tag_bytes() || place - file.tag_bytes() > data.size() ||
        data.size() - (place - file.tag_bytes()) < 4 * bins)
      refuse("curve " + std::to_string(i) + " lies outside the file");
    if (std::abs(file.require("HistResDscr_MDescResolution", i) - step_s) > 1e-9 * step_s)
      refuse("curve " + std::to_string(i) + " has another resolution than the first one");
    PicoquantCurve curve{.recorded = file.time("HistResDscr_TimeofRecording", i),
                         .length_s = file.require("MeasDesc_AcquisitionTime") / 1e3,
                         .sync_hz = file.number("HistResDscr_SyncRate", i),
                         .counts = to_values<std::uint32_t>(
                             ByteView(data).subspan(place - file.tag_bytes(), 4 * bins))};
    while (!curve.counts.empty() && curve.counts.back() == 0) curve.counts.pop_back();
    used = std::max(used, curve.counts.size());
    out.curves.push_back(std::move(curve));
  }
  constexpr std::size_t most_counts = std::size_t{1} << 28;
  if (used * out.curves.size() > most_counts) refuse("its curves together are too long");
  for (PicoquantCurve& curve : out.curves) curve.counts.resize(used);
  out.device.axes.push_back({.name = "spd",
                             .quantity = "counts",
                             .unit = "ps",
                             .count = static_cast<std::uint32_t>(used),
                             .start = 0,
                             .step = std::round(1e15 * step_s) / 1e3,
                             .scale = 1});
  return out;
}

}  // namespace echofuse::acquire
