// SPDX-License-Identifier: MIT
// Input: transfers, each u16 and bytes. Bits 0..13 of the u16: how many bytes; bit 15: a short
// packet ends it; bit 14: the records are interrupted before it. The reader against one that looks
// at whole runs.
#include <utility>

#include "drivers/tdc/usb_protocol.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::tdc::usb;
using fuzz::require;

namespace {

constexpr std::uint16_t length_mask = 0x3fff, interrupted = 0x4000, ended = 0x8000;

struct Taken {
  std::vector<Tag> tags;
  std::vector<std::size_t> gaps;  // before the tags of these indices
};

bool is_sound(const Tag& tag) {
  const auto type = static_cast<unsigned>(tag.type);
  return type <= 4 && tag.reserved == 0 && (type == 4 || tag.missed_events == 0) &&
         tag.channel >= -1024 && tag.channel <= 1024;
}

struct Reference {
  Taken taken{};
  RecordCounts counts{};
  std::size_t waiting = 0;
  Bytes run{};
  bool gap = false;

  void end_run(bool interrupt) {
    take_sound();
    const std::uint64_t junk = run.size() - taken_of_run * sizeof(Tag);
    counts.junk_bytes += junk;
    counts.gaps += junk > 0;
    gap = gap || junk > 0 || interrupt;
    run.clear();
    taken_of_run = 0;
  }
  // What stands at the end of the input without an end of its run.
  void finish() {
    take_sound();
    const std::size_t rest = run.size() - taken_of_run * sizeof(Tag);
    waiting = rest < sizeof(Tag) ? rest : 0;
    counts.junk_bytes += rest - waiting;
    counts.gaps += rest > waiting;
  }

 private:
  void take_sound() {
    for (const Tag& tag : to_values<Tag>(run)) {
      if (!is_sound(tag)) break;
      if (std::exchange(gap, false)) taken.gaps.push_back(taken.tags.size());
      taken.tags.push_back(tag);
      ++counts.tags;
      ++taken_of_run;
    }
  }
  std::size_t taken_of_run = 0;
};

void feed(RecordReader& reader, ByteView bytes, bool ends, Taken& taken) {
  const std::size_t before = taken.tags.size();
  if (reader.feed(bytes, ends, taken.tags)) taken.gaps.push_back(before);
}

void require_same(const RecordReader& reader, const Taken& taken, const Reference& wanted) {
  require(std::ranges::equal(as_bytes(taken.tags), as_bytes(wanted.taken.tags)),
          "the tags are the sound records of each run up to the first that is not");
  require(taken.gaps == wanted.taken.gaps, "gaps are told before the tags that follow them");
  const RecordCounts& counts = reader.counts();
  require(counts.tags == wanted.counts.tags && counts.junk_bytes == wanted.counts.junk_bytes,
          "every byte is a tag's, junk or waits");
  require(counts.gaps == wanted.counts.gaps, "each stretch of junk is one gap");
}

}  // namespace

void fuzz::run(ByteView input) {
  RecordReader whole, pieces;
  Taken of_whole, of_pieces;
  Reference reference;
  const std::uint64_t all = input.size();
  std::uint64_t fed = 0;
  for (ByteReader in(input); in.left() >= 2;) {
    const auto control = in.get<std::uint16_t>();
    const bool ends = (control & ended) != 0;
    const ByteView bytes = in.take(std::min<std::size_t>(control & length_mask, in.left()));
    if (control & interrupted) {
      reference.end_run(true);
      whole.interrupt();
      pieces.interrupt();
    }
    fed += bytes.size();
    reference.run.insert(reference.run.end(), bytes.begin(), bytes.end());
    if (ends) reference.end_run(false);
    feed(whole, bytes, ends, of_whole);
    in_pieces(bytes, control, [&](ByteView piece) { feed(pieces, piece, false, of_pieces); });
    if (ends) feed(pieces, {}, true, of_pieces);
  }
  reference.finish();
  require(fed <= all && reference.counts.tags * sizeof(Tag) + reference.counts.junk_bytes +
                                reference.waiting ==
                            fed,
          "the reference adds up");
  require_same(whole, of_whole, reference);
  require_same(pieces, of_pieces, reference);
}
