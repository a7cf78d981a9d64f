// SPDX-License-Identifier: MIT
#include "drivers/tdc/usb_protocol.hpp"

#include <algorithm>
#include <utility>

namespace echofuse::tdc::usb {
namespace {

constexpr std::int32_t max_channel = 1024;

// Seven bytes of a record have to be what they are: a shifted stream does not pass for long.
bool is_sound(const Tag& tag) {
  return tag.type <= TagType::missed_events && tag.reserved == 0 &&
         (tag.missed_events == 0 || tag.type == TagType::missed_events) &&
         tag.channel >= -max_channel && tag.channel <= max_channel;
}

}  // namespace

bool RecordReader::feed(ByteView bytes, bool ends, std::vector<Tag>& out) {
  const bool gap_before = std::exchange(gap_, false);
  const std::size_t before = out.size();
  if (!in_junk_) bytes = take_records(bytes, out);
  carry_.insert(carry_.end(), bytes.begin(), bytes.end());
  if (in_junk_ || ends) discard(std::exchange(carry_, {}).size());
  if (ends) in_junk_ = false;
  const std::size_t taken = out.size() - before;
  counts_.tags += taken;
  if (taken > 0) return gap_before;
  gap_ = gap_ || gap_before;  // nothing to tell it before
  return false;
}

// All whole records up to the first that is not sound; returns the bytes after them.
ByteView RecordReader::take_records(ByteView bytes, std::vector<Tag>& out) {
  const std::size_t whole = (carry_.size() + bytes.size()) / sizeof(Tag);
  if (whole == 0) return bytes;
  const std::size_t before = out.size(), fresh = whole * sizeof(Tag) - carry_.size();
  out.resize(before + whole);
  auto* const target = reinterpret_cast<std::uint8_t*>(out.data() + before);
  std::copy(carry_.begin(), carry_.end(), target);
  std::copy_n(bytes.begin(), fresh, target + carry_.size());
  carry_.clear();
  const auto bad =
      std::find_if_not(out.begin() + static_cast<std::ptrdiff_t>(before), out.end(), is_sound);
  if (bad != out.end()) {
    discard(static_cast<std::size_t>(out.end() - bad) * sizeof(Tag));
    in_junk_ = true;
    out.erase(bad, out.end());
  }
  return bytes.subspan(fresh);
}

void RecordReader::interrupt() {
  discard(std::exchange(carry_, {}).size());
  gap_ = true;
  in_junk_ = false;
}

void RecordReader::discard(std::size_t bytes) {
  if (bytes == 0) return;
  counts_.junk_bytes += bytes;
  if (!in_junk_) ++counts_.gaps;
  gap_ = true;
}

}  // namespace echofuse::tdc::usb
