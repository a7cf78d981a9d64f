// SPDX-License-Identifier: MIT
// Common part of the fuzz targets. Each target is a function run(). entry.cpp passes it to
// libFuzzer in the preset "fuzz". replay.cpp runs it on its corpus in other presets.
#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <string>
#include <string_view>

#include "drivers/core/bytes.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::fuzz {

void run(ByteView input);

// Aborts if an invariant is violated, so that the fuzzer saves the input.
inline void require(bool holds, const char* invariant) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", invariant);
  std::abort();
}

// Calls take(piece) for consecutive pieces of 0 to 63 bytes. The seed determines the lengths of the
// pieces.
template <class Take>
void in_pieces(ByteView bytes, std::uint32_t seed, const Take& take) {
  while (!bytes.empty()) {
    seed = seed * 1664525u + 1013904223u;
    const ByteView piece = bytes.first(std::min<std::size_t>(bytes.size(), seed >> 26));
    take(piece);
    bytes = bytes.subspan(piece.size());
  }
}

inline std::string_view text_of(ByteView bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Returns true if `text` contains no control characters except those in `also`.
inline bool is_printable(std::string_view text, std::string_view also = "") {
  return std::all_of(text.begin(), text.end(), [&](char c) {
    const auto code = static_cast<unsigned char>(c);
    return (code >= 0x20 && code != 0x7f) || also.find(c) != also.npos;
  });
}

// Checks the text of a fault with several lines. Each line must begin with `begin`, or end a list
// that is too long.
inline void require_faults(std::string_view faults, std::string_view begin) {
  require(!faults.empty() && is_printable(faults, "\n"), "faults can be printed");
  for (; !faults.empty(); faults.remove_prefix(std::min(faults.find('\n'), faults.size() - 1) + 1))
    require(faults.starts_with(begin) || faults.starts_with("there are more errors"),
            "each line is one fault with its position");
}

// Runs `body`. If `body` throws an Error, its code must be one of `codes`, and its message must be
// printable. The message must be a single line unless `lines` is true.
template <class Body>
void refused_or_done(std::initializer_list<ExitCode> codes, Body body, bool lines = false) {
  try {
    body();
  } catch (const Error& error) {
    require(std::ranges::find(codes, error.code()) != codes.end(), "a fault has an expected code");
    require(*error.what() != '\0' && is_printable(error.what(), lines ? "\n" : ""),
            "a fault can be printed");
  }
}

// Runs `body`. If `body` throws an Error, it must be a fault of a configuration in which each line
// begins with `begin`. Returns the faults.
template <class Body>
std::string faults_by(std::string_view begin, Body body) {
  try {
    body();
  } catch (const Error& error) {
    require(error.code() == ExitCode::config, "a fault has the code of a configuration");
    require_faults(error.what(), begin);
    return error.what();
  }
  return {};
}

}  // namespace echofuse::fuzz

using namespace echofuse;
using fuzz::require;
