// SPDX-License-Identifier: MIT
// Compares the parser results of recorded and damaged bytes with stored results. tests/fuzz/corpus
// contains the bytes, and recorded/NAME.txt has one line per file. After an intended change, check
// the printed line and copy it into the table.
#include <iterator>
#include <map>

#include "../catch.hpp"
#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/radar/frame_parser.hpp"
#include "hex.hpp"

namespace {

// Returns the contents of the file except the first byte, which only determines how the fuzzer
// splits the stream.
Bytes stream_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  in.get();
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string line_of(const std::vector<Counter>& counters, const std::string& delivered) {
  std::ostringstream line;
  for (const Counter& c : counters)
    if (c.value > 0) line << c.name << ' ' << c.value << ", ";
  line << "delivered:" << delivered;
  return line.str();
}

std::string radar_frames(const Bytes& stream) {
  radar::FrameParser parser(12);
  std::ostringstream delivered;
  const auto keep = [&](const RadarFrame& f) {
    delivered << ' ' << f.frame_number << '/' << f.power.size() << '/' << f.array.size();
  };
  parser.feed(stream, HostTime{}, keep);
  parser.finish(keep);
  return line_of(counters_of(parser.counts()), delivered.str());
}

std::string bridge_blocks(const Bytes& stream) {
  bridge::BlockParser parser;
  std::ostringstream delivered;
  const auto keep = [&](const bridge::Block& b) {
    delivered << ' ' << static_cast<int>(b.kind) << '#' << b.sequence << '/' << b.payload.size();
  };
  parser.feed(stream, keep);
  return line_of(counters_of(parser.counts()), delivered.str());
}

using Table = std::map<std::string, std::string>;  // expected line for each file name

Table expected(const std::string& name) {
  std::ifstream in(test::source_dir + "/tests/drivers/recorded/" + name + ".txt");
  Table table;
  for (std::string file, line; in >> file && std::getline(in >> std::ws, line);) table[file] = line;
  return table;
}

}  // namespace

TEST_CASE("the parsers return the expected results for recorded byte streams of devices") {
  const auto [name, parse] = GENERATE(table<std::string, std::string (*)(const Bytes&)>(
      {{"radar_frames", radar_frames}, {"bridge_blocks", bridge_blocks}}));
  const Table table = expected(name);
  std::size_t files = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(test::source_dir + "/tests/fuzz/corpus/" + name)) {
    const std::string file = entry.path().filename().string();
    CAPTURE(name, file);
    CHECK(parse(stream_of(entry.path())) == (table.contains(file) ? table.at(file) : "no line"));
    ++files;
  }
  CHECK(files == table.size());
}
