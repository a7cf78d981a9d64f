// SPDX-License-Identifier: MIT
#include "acquire/commands/replay.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "drivers/program/printable.hpp"
#include "drivers/program/regular_file.hpp"
#include "drivers/radar/frame_parser.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t chunk_bytes = 4096;  // as a serial port hands them out

// What FrameCounts does not hold: sizes of the profiles, frames with the other known TLVs.
struct Contents {
  std::map<std::size_t, std::uint64_t> profiles_by_bins, arrays_by_samples;
  std::uint64_t stats = 0, temperatures = 0;
};

template <class Visit>
void for_each_chunk(const std::string& path, const Visit& visit) {
  const RegularFile in(path, ExitCode::failed);
  std::array<std::uint8_t, chunk_bytes> chunk;
  while (const std::size_t count = in.read(chunk)) visit(ByteView(chunk.data(), count));
}

Json to_json(const radar::FrameCounts& c, const Contents& contents) {
  Json bins = Json::object();
  for (const auto& [size, frames] : contents.profiles_by_bins) bins[std::to_string(size)] = frames;
  Json samples = Json::object();
  for (const auto& [size, frames] : contents.arrays_by_samples)
    samples[std::to_string(size)] = frames;
  Json types = Json::object();
  for (const auto& [type, count] : c.tlvs) types[std::to_string(type)] = count;
  const auto number = [](const std::optional<std::uint32_t>& n) { return n ? Json(*n) : Json(); };
  Json all;
  for (const Counter& counter : radar::counters_of(c)) all[counter.name] = counter.value;
  all.update({{"range_profiles_by_bins", bins},
              {"arrays_by_samples", samples},
              {"stats", contents.stats},
              {"temperatures", contents.temperatures},
              {"tlvs_by_type", types},
              {"first_frame_number", number(c.first_frame_number)},
              {"last_frame_number", number(c.last_frame_number)}});
  return all;
}

std::string to_text(const Json& json) {
  std::string out;
  for (const auto& [key, value] : json.items()) {
    std::string name = key;
    std::replace(name.begin(), name.end(), '_', ' ');
    name.resize(24, ' ');
    out += name + (value.is_string() ? printable(value.get<std::string>()) : value.dump()) + "\n";
  }
  return out;
}

}  // namespace

Replayed replay_result(const std::vector<std::string>& paths, const Json& counts,
                       const char* samples, bool json) {
  std::string names;
  for (const std::string& path : paths) names += (names.empty() ? "" : " ") + utf8_text(path);
  Json all{{"file", names}};
  all.update(counts);
  return {json ? all.dump(2, ' ', true, Json::error_handler_t::replace) + "\n" : to_text(all),
          counts.at(samples) > 0};
}

Replayed replay_radar(const std::vector<std::string>& paths, bool json) {
  radar::FrameParser parser;
  Contents contents;
  const auto on_frame = [&](const RadarFrame& frame) {
    if (!frame.range_profile.empty()) ++contents.profiles_by_bins[frame.range_profile.size()];
    if (!frame.array.empty()) ++contents.arrays_by_samples[frame.array.size() / 2];
    contents.stats += frame.stats.has_value();
    contents.temperatures += frame.temperature.has_value();
  };
  for (const std::string& path : paths) {
    for_each_chunk(path, [&](ByteView chunk) { parser.feed(chunk, HostTime{}, on_frame); });
    parser.finish(on_frame);
  }
  return replay_result(paths, to_json(parser.counts(), contents), "frames", json);
}

}  // namespace echofuse::acquire
