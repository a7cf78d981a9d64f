// SPDX-License-Identifier: MIT
// Time tags over USB: USB.md in this folder is the specification. Little-endian.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::tdc::usb {

// The interface by which a device says that it speaks this.
inline constexpr std::uint8_t interface_class = 0xff, interface_subclass = 0x45,
                              interface_protocol = 0x01;

// Vendor requests to the interface; wValue 0, wIndex the interface.
inline constexpr std::uint8_t vendor_in = 0xc1, vendor_out = 0x41;  // bmRequestType
enum class Request : std::uint8_t { info = 1, status = 2, start = 3, stop = 4 };

struct Info {
  std::uint16_t version = 0;       // 1
  std::uint16_t record_bytes = 0;  // 16
  std::uint32_t fifo_tags = 0;     // how many the device can hold
  std::uint64_t reserved = 0;
};
struct Status {
  std::uint32_t flags = 0;  // bit 0: started, bit 1: it is losing tags
  std::uint32_t reserved = 0;
  std::uint64_t tags = 0;  // sent since the start
  std::uint64_t lost = 0;  // since the start, for want of room
};
static_assert(sizeof(Info) == 16 && sizeof(Status) == 24);

template <class T>
std::optional<T> read_struct(ByteView answer) {
  ByteReader reader(answer);
  const T value = reader.get<T>();
  return reader.ok() ? std::optional<T>(value) : std::nullopt;
}

// One transfer as a run keeps it: u32, bits 0..29 the count of bytes that follow, bit 30: records
// are missing here for another reason, bit 31: it ended with a short or empty packet.
inline constexpr std::uint32_t kept_bytes_mask = 0x3fffffff, kept_gap = 1u << 30,
                               kept_end = 1u << 31;

// tags * 16 + junk_bytes + bytes of a record that is still incomplete == all bytes.
struct RecordCounts {
  std::uint64_t tags = 0;
  std::uint64_t junk_bytes = 0;
  std::uint64_t gaps = 0;  // stretches of junk
};

// Transfers -> sound records. A record may be spread over transfers, but never over the short
// packet that ends a run: what is left there is junk, and so is everything from the first record
// that is not sound to the end of its run.
class RecordReader {
 public:
  // Appends the tags of a transfer; `ends`: it ended with a short or empty packet.
  // True: records are missing before the appended ones.
  bool feed(ByteView bytes, bool ends, std::vector<Tag>& out);
  // Records are missing here for another reason, and what waits is junk.
  void interrupt();
  const RecordCounts& counts() const { return counts_; }

 private:
  ByteView take_records(ByteView bytes, std::vector<Tag>& out);
  void discard(std::size_t bytes);

  RecordCounts counts_;
  Bytes carry_;           // the beginning of a record
  bool in_junk_ = false;  // until the run ends
  bool gap_ = false;
};

}  // namespace echofuse::tdc::usb
