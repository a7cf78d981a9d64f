// SPDX-License-Identifier: MIT
// Compares the parser results of recorded and damaged bytes with stored results. tests/fuzz/corpus
// contains the bytes, and recorded/NAME.txt has one line per file. After an intended change, check
// the printed line and copy it into the table.
#include <iterator>
#include <map>

#include "../catch.hpp"
#include "drivers/bridge/bridge_protocol.hpp"
#include "hex.hpp"
#include "parsed_frames.hpp"

namespace {

// Returns the contents of the file except the first byte, which only determines how the fuzzer
// splits the stream.
Bytes stream_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  in.get();
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string radar_frames(const Bytes& stream) { return test::parse_frames(stream).line(); }

std::string bridge_blocks(const Bytes& stream) {
  bridge::BlockParser parser;
  std::ostringstream delivered;
  parser.feed(stream, [&](const bridge::Block& b) {
    delivered << ' ' << static_cast<int>(b.kind) << '#' << b.sequence << '/' << b.payload.size();
  });
  return test::line_of(counters_of(parser.counts())) + "delivered:" + delivered.str();
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
