// SPDX-License-Identifier: MIT
// Benchmark of the tagger's data path in memory, in processor time, as the best of 7 rounds. Every
// round runs all parts, so that other processes affect all parts equally. The histogram is measured
// with every instruction set, and without processing tags in groups. Its rate is compared with that
// of a plain loop. The limit is the rate of reading the tags. scripts/bench reads the lines that
// begin with "row" or "peer". A row contains the code path, the unit, the value of echofuse, the
// limit and the kind of limit.
#include <hwy/highway.h>

#include <cstdio>
#include <functional>
#include <string>

#include "acquire/intake/tag_check.hpp"
#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/bridge/bridge_writer.hpp"
#include "drivers/core/crc32c.hpp"
#include "drivers/core/random.hpp"
#include "limits.hpp"

using namespace echofuse;

namespace {

constexpr std::size_t count = 1u << 22, tags_a_block = 1u << 12;

// Returns start tags, each followed by one click or, if `random`, by 0 to 2 clicks.
std::vector<Tag> make_tags(bool random) {
  Rng rng = make_rng(1, 1);
  std::vector<Tag> tags;
  for (std::int64_t time = 0; tags.size() < count; time += 100'000) {
    tags.push_back({.channel = 1, .time_ps = time});
    std::int64_t click = time + 12'000;
    for (auto n = random ? rng() % 3 : 1; n > 0; --n) {
      click += static_cast<std::int64_t>(rng() % 18'000);
      tags.push_back({.channel = 2, .time_ps = click});
    }
  }
  tags.resize(count);
  return tags;
}

Bytes make_blocks(const std::vector<Tag>& tags) {
  Bytes out;
  const ByteView all = as_bytes(tags);
  constexpr std::size_t size = tags_a_block * sizeof(Tag);
  for (std::uint32_t i = 0; i < count / tags_a_block; ++i) {
    const Bytes block =
        bridge::make_block(bridge::BlockKind::tags, i, 0, all.subspan(i * size, size));
    out.insert(out.end(), block.begin(), block.end());
  }
  return out;
}

struct Row {
  std::string name;
  std::function<void()> work;
  double best_s = std::numeric_limits<double>::max();

  double mtags_per_s() const { return static_cast<double>(count) / best_s / 1e6; }
};

void measure(std::vector<Row>& rows) {
  for (int round = 0; round < 7; ++round)
    for (Row& row : rows) {
      const double begin = bench::processor_s();
      row.work();
      row.best_s = std::min(row.best_s, bench::processor_s() - begin);
    }
}

// Prints the rates. The last row is the limit.
void print(const char* title, const std::vector<Row>& rows) {
  std::printf("%-40s %10s %10s\n", title, "Mtags/s", "of limit");
  for (const Row& row : rows)
    std::printf("  %-38s %10.0f %9.0f %%\n", row.name.c_str(), row.mtags_per_s(),
                100 * rows.back().best_s / row.best_s);
}

void naive(const std::vector<Tag>& tags, std::vector<std::uint32_t>& bins) {
  std::int64_t start = 0;
  for (const Tag& tag : tags) {
    if (tag.type != TagType::time_tag) continue;
    if (tag.channel == 1) {
      start = tag.time_ps;
    } else if (tag.channel == 2) {
      const std::int64_t bin = (tag.time_ps - start - 13343) / 100;
      if (bin >= 0 && bin < 336) ++bins[static_cast<std::size_t>(bin)];
    }
  }
}

std::uint64_t read(const std::vector<Tag>& tags) {
  std::uint64_t sum = 0;
  for (const Tag& tag : tags) sum += static_cast<std::uint64_t>(tag.time_ps);
  return sum;
}

bool takes_groups(std::int64_t target, const std::vector<Tag>& tags) {
  hwy::GetChosenTarget().Update(target);
  std::uint32_t cells[2] = {};
  tdc::TagRun run;
  return tdc::count_groups(tags.data(), tdc::max_group, {}, run, cells) > 0;
}

// Measures the rates of all methods; returns false if two methods give different counts.
bool histograms(const char* stream, bool random) {
  const auto tags = make_tags(random);
  std::vector<Row> rows;
  tdc::Histogram expected({});
  bool equal = true;
  const auto with = [&](std::int64_t target, const std::string& name) {
    rows.push_back({name, [&, target] {
                      hwy::GetChosenTarget().Update(target);
                      tdc::Histogram histogram({});
                      histogram.add(tags);
                      if (expected.tag_counts().tags == 0) expected = histogram;
                      equal = equal && histogram.counts() == expected.counts() &&
                              histogram.tag_counts() == expected.tag_counts();
                    }});
  };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets())
    if (takes_groups(target, tags)) with(target, hwy::TargetName(target));
  with(HWY_SCALAR, "tag by tag");
  std::vector<std::uint32_t> bins(336);
  rows.push_back({"plain loop, nothing counted", [&] { naive(tags, bins); }});
  std::uint64_t sum = 0;
  rows.push_back({"reading the tags", [&] { sum += read(tags); }});
  measure(rows);
  hwy::GetChosenTarget().DeInit();
  const std::string path = std::string("histogram of ") + stream + " tags";
  print(path.c_str(), rows);
  bench::print_row(path.c_str(), "Mtags/s", rows.front().mtags_per_s(), rows.back().mtags_per_s(),
                   "reading the tags");
  const Row& peer = rows[rows.size() - 2];
  bench::print_peer(path.c_str(), peer.name.c_str(), peer.mtags_per_s());
  return equal && sum > 0 && bins[100] > 0;
}

bool transport() {
  const auto tags = make_tags(true);
  const Bytes blocks = make_blocks(tags);
  std::vector<Tag> copy(tags);
  std::uint64_t seen = 0, sum = 0;
  std::vector<Row> rows{
      {"CRC-32C", [&] { sum += crc32c(as_bytes(tags)); }},
      {"bridge block parser",
       [&] {
         bridge::BlockParser parser;
         for (ByteView rest = blocks; !rest.empty();) {  // pieces of the size of one TCP read
           const ByteView piece = rest.first(std::min<std::size_t>(rest.size(), 1u << 18));
           parser.feed(piece, [&](const bridge::Block& b) { seen += b.payload.size(); });
           rest = rest.subspan(piece.size());
         }
       }},
      {"memcpy", [&] { std::copy(tags.begin(), tags.end(), copy.begin()); }},
      {"reading the tags", [&] { sum += read(tags); }}};
  measure(rows);
  print("the way to the histogram", rows);
  bench::print_row("bridge block parser", "Mtags/s", rows[1].mtags_per_s(),
                   rows.back().mtags_per_s(), "reading the tags");
  return seen == 7 * count * sizeof(Tag) && sum > 0;
}

// Measures the tag rate from bridge blocks to the histogram, with and without the checks of a run
// (acquire/intake/tag_check.hpp).
bool checked() {
  const auto tags = make_tags(true);
  std::uint64_t starts[2] = {};
  const auto path = [&](bool check) {
    tdc::Histogram histogram({});
    const auto add = [&](const TagBlock& block) { histogram.add(block.tags); };
    acquire::TagCheck checks({}, true, [](const std::string&) {});
    for (std::size_t i = 0; i < count; i += tags_a_block) {
      // In the first second of the stream, the check only stores events, so this second contains
      // only one block.
      const HostTime received{i == 0 ? 0 : 1'000'000'000 + tags[i].time_ps / 1000};
      const TagBlock block{.received = received, .tags = std::span(tags).subspan(i, tags_a_block)};
      check ? checks.take(block, add) : add(block);
    }
    checks.flush(add);
    starts[check] = histogram.tag_counts().starts;
  };
  std::uint64_t sum = 0;
  std::vector<Row> rows{{"histogram", [&] { path(false); }},
                        {"checks and histogram", [&] { path(true); }},
                        {"reading the tags", [&] { sum += read(tags); }}};
  measure(rows);
  print("blocks of tags", rows);
  bench::print_row("checks and histogram of tags", "Mtags/s", rows[1].mtags_per_s(),
                   rows.back().mtags_per_s(), "reading the tags");
  return starts[0] == starts[1] && sum > 0;
}

}  // namespace

int main() {
  const bool random = histograms("random", true), alternating = histograms("alternating", false);
  return random && alternating && transport() && checked() ? 0 : 1;
}
