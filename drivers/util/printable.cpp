// SPDX-License-Identifier: MIT
#include "drivers/util/printable.hpp"

#include <algorithm>
#include <cstdint>

#include "drivers/util/format.hpp"

namespace echofuse {
namespace {

struct Character {
  std::size_t bytes = 1;
  std::uint32_t code = 0;
  bool valid = false;
};

// Decodes the first UTF-8 character. Rejects overlong forms and surrogates (RFC 3629).
Character first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::uint32_t lead = byte(0);
  if (lead < 0x80) return {1, lead, true};
  const std::size_t bytes = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < bytes) return {};
  std::uint32_t code = lead & (0xffu >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0u) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3fu);
  }
  // smallest code point with this number of bytes (RFC 3629), to reject overlong encodings
  constexpr std::uint32_t smallest[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code <= 0xdfff;
  if (code < smallest[bytes] || code > 0x10ffff || surrogate) return {};
  return {bytes, code, true};
}

// Returns true for characters that affect a terminal: control characters (C0, delete, C1), line
// separators, and characters that change the text direction.
bool is_obeyed(std::uint32_t c) {
  return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0x61c || (c >= 0x200e && c <= 0x200f) ||
         (c >= 0x2028 && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069) || c == 0xfeff;
}

void put_written_out(std::string& out, std::string_view bytes, const Character& c) {
  if (c.valid && c.code == '\n')
    out += "\\n";
  else if (c.valid && c.code == '\t')
    out += "\\t";
  else if (c.valid && c.code >= 0x80)
    out += format("\\u%04x", static_cast<unsigned>(c.code));
  else
    out += format("\\x%02x", static_cast<unsigned char>(bytes[0]));
}

enum class Kept { printed, lines, all };  // characters that are not escaped

std::string escaped(std::string_view text, std::size_t longest, Kept kept) {
  std::string out;
  out.reserve(std::min(text.size(), longest));
  while (!text.empty()) {
    if (out.size() >= longest) return out + "...";
    const Character c = first_of(text);
    if (c.valid &&
        (kept == Kept::all || !is_obeyed(c.code) || (kept == Kept::lines && c.code == '\n')))
      out += text.substr(0, c.bytes);
    else
      put_written_out(out, text, c);
    text.remove_prefix(c.bytes);
  }
  return out;
}

}  // namespace

std::string printable(std::string_view text, std::size_t longest) {
  return escaped(text, longest, Kept::printed);
}

std::string printable_lines(std::string_view text) {
  return escaped(text, std::string_view::npos, Kept::lines);
}

std::string utf8_text(std::string_view text) {
  return escaped(text, std::string_view::npos, Kept::all);
}

}  // namespace echofuse
