// SPDX-License-Identifier: MIT
// The tagger's path from memory, beside memcpy of the same bytes. Best of 7 rounds, one core; every
// round runs all of them, so that a busy machine hurts all alike.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <limits>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/crc32c.hpp"
#include "drivers/core/random.hpp"
#include "drivers/tdc/histogram.hpp"

using namespace echofuse;

namespace {

constexpr std::size_t count = 1u << 21, tags_a_block = 1u << 12;

// One start, then 0 to 2 clicks, at random.
std::vector<Tag> make_tags() {
  Rng rng = make_rng(1, 1);
  std::vector<Tag> tags;
  std::int64_t time = 0;
  while (tags.size() < count) {
    tags.push_back({.channel = 1, .time_ps = time});
    for (auto n = rng() % 3; n > 0; --n)
      tags.push_back({.channel = 2,
                      .time_ps = time + 10'000 * static_cast<std::int64_t>(3 - n) +
                                 static_cast<std::int64_t>(rng() % 9'000)});
    time += 100'000;
  }
  tags.resize(count);
  return tags;
}

Bytes make_blocks(const std::vector<Tag>& tags) {
  Bytes out;
  const ByteView all = as_bytes(tags);
  constexpr std::size_t size = tags_a_block * sizeof(Tag);
  for (std::uint32_t i = 0; i < count / tags_a_block; ++i) {
    const std::size_t begin = out.size();
    for (const char c : {'E', 'F', 'B', 'R'}) out.push_back(static_cast<std::uint8_t>(c));
    put(out, bridge::protocol_version);
    put(out, std::uint16_t{1});
    put(out, i);
    put(out, static_cast<std::uint32_t>(size));
    put(out, std::uint64_t{0});
    put(out, std::uint32_t{0});
    const ByteView payload = all.subspan(i * size, size);
    put(out, crc32c(payload, crc32c(ByteView(out).subspan(begin))));
    out.insert(out.end(), payload.begin(), payload.end());
  }
  return out;
}

struct Row {
  const char* name;
  double best_s = std::numeric_limits<double>::max();
};

template <class Work>
void time(Row& row, const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  row.best_s = std::min(row.best_s, took.count());
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

}  // namespace

int main() {
  const auto tags = make_tags();
  const Bytes blocks = make_blocks(tags);
  std::vector<Tag> copy(tags);
  std::vector<std::uint32_t> bins(336);
  Row rows[] = {{"memcpy"},
                {"reading the bytes"},
                {"naive histogram, no counts"},
                {"histogram, all counts"},
                {"CRC-32C"},
                {"bridge block parser"}};
  std::uint64_t seen = 0, sum = 0;
  for (int round = 0; round < 7; ++round) {
    time(rows[0], [&] { std::copy(tags.begin(), tags.end(), copy.begin()); });
    time(rows[1], [&] {
      for (const Tag& tag : copy) sum += static_cast<std::uint64_t>(tag.time_ps);
    });
    time(rows[2], [&] { naive(copy, bins); });
    time(rows[3], [&] {
      tdc::Histogram histogram({});
      histogram.add(copy);
      seen += histogram.tag_counts().tags;
    });
    time(rows[4], [&] { sum += crc32c(as_bytes(copy)); });
    time(rows[5], [&] {
      bridge::BlockParser parser;
      parser.feed(blocks, [&](const bridge::Block& b) { seen += b.payload.size() / sizeof(Tag); });
    });
  }
  if (seen != 14 * count || sum == 0 || bins[100] == 0) return 1;
  std::printf("%-28s %10s %10s\n", "", "Mtags/s", "of memcpy");
  for (const Row& row : rows)
    std::printf("%-28s %10.0f %10.2f\n", row.name, static_cast<double>(count) / row.best_s / 1e6,
                rows[0].best_s / row.best_s);
}
