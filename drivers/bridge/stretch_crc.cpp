// SPDX-License-Identifier: MIT
#include "drivers/bridge/stretch_crc.hpp"

#include "drivers/core/crc32c.hpp"

namespace echofuse::bridge {
namespace {

constexpr std::uint64_t spacing = 256;

}  // namespace

std::uint32_t StretchCrc::of(ByteView bytes, std::uint64_t place, std::size_t from,
                             std::size_t count, std::uint32_t crc) {
  const auto view = [&](std::uint64_t begin, std::uint64_t end) {
    return bytes.subspan(static_cast<std::size_t>(begin - place),
                         static_cast<std::size_t>(end - begin));
  };
  const std::uint64_t begin = place + from, end = begin + count;
  const std::uint64_t mark = (begin + spacing - 1) / spacing * spacing;  // the first in the stretch
  if (end <= mark) return crc32c(view(begin, end), crc);
  for (; !marks_.empty() && first_ < place; first_ += spacing) marks_.pop_front();
  if (marks_.empty()) {
    first_ = mark;
    marks_.push_back(0);
  }
  for (std::uint64_t at = first_ + spacing * marks_.size(); at <= end; at += spacing)
    marks_.push_back(crc32c(view(at - spacing, at), marks_.back()));
  const auto crc_at = [&](std::uint64_t at) {
    return marks_[static_cast<std::size_t>((at - first_) / spacing)];
  };
  const std::uint64_t last = end / spacing * spacing;
  crc = crc32c(view(begin, mark), crc);
  // The bytes from `mark` to `last`, by what the CRCs of both say of them.
  const std::uint32_t middle = crc_at(last) ^ crc32c_shift(crc_at(mark) ^ crc, last - mark);
  return crc32c(view(last, end), middle);
}

}  // namespace echofuse::bridge
