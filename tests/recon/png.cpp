// SPDX-License-Identifier: MIT
// Tests the decoder with PNG files as other programs write them, and with damaged files.
#include "recon/maps/png.hpp"

#include <zlib.h>

#include "../catch.hpp"
#include "acquire/record/deflate.hpp"

namespace {

constexpr std::uint32_t width = 19, height = 15;
constexpr std::size_t row_bytes = std::size_t{2} * width;
constexpr int filters = 5;

std::vector<std::uint16_t> some_pixels() {
  std::mt19937 random(1);
  std::vector<std::uint16_t> out(std::size_t{width} * height);
  for (auto& v : out) v = static_cast<std::uint16_t>(random() % 3 ? 2000 + random() % 500 : 0);
  return out;
}

void put(Bytes& out, std::uint32_t v) {
  for (const int shift : {24, 16, 8, 0}) out.push_back(static_cast<std::uint8_t>(v >> shift));
}

void put_chunk(Bytes& out, const std::string& name, ByteView data) {
  put(out, static_cast<std::uint32_t>(data.size()));
  Bytes named(name.begin(), name.end());
  named.insert(named.end(), data.begin(), data.end());
  out.insert(out.end(), named.begin(), named.end());
  put(out, static_cast<std::uint32_t>(crc32(0, named.data(), static_cast<uInt>(named.size()))));
}

// Returns the Paeth predictor of the PNG standard (section 9.4).
int paeth(int a, int b, int c) {
  const int p = a + b - c, pa = std::abs(p - a), pb = std::abs(p - b), pc = std::abs(p - c);
  if (pa <= pb && pa <= pc) return a;
  return pb <= pc ? b : c;
}

// Filters the rows. Row y uses the filter (first + y) % 5. If `first` is 5, all rows use the
// invalid filter 5.
Bytes filtered(const std::vector<std::uint16_t>& pixels, int first) {
  Bytes out, above(row_bytes), row(row_bytes);
  for (std::size_t y = 0; y < height; ++y, above = row) {
    for (std::size_t x = 0; x < width; ++x) {
      row[2 * x] = static_cast<std::uint8_t>(pixels[y * width + x] >> 8);
      row[2 * x + 1] = static_cast<std::uint8_t>(pixels[y * width + x]);
    }
    const int filter = first == filters ? first : (first + static_cast<int>(y)) % filters;
    out.push_back(static_cast<std::uint8_t>(filter));
    for (std::size_t i = 0; i < row_bytes; ++i) {
      const int a = i < 2 ? 0 : row[i - 2], b = above[i], c = i < 2 ? 0 : above[i - 2];
      const int guess[] = {0, a, b, (a + b) / 2, paeth(a, b, c), 0};
      out.push_back(static_cast<std::uint8_t>(row[i] - guess[filter]));
    }
  }
  return out;
}

Bytes packed(const Bytes& bytes) {
  Bytes out(compressBound(bytes.size()));
  uLongf size = out.size();
  REQUIRE(compress(out.data(), &size, bytes.data(), bytes.size()) == Z_OK);
  out.resize(size);
  return out;
}

// Returns a PNG file that contains the filtered rows. The compressed data are split into `parts`
// chunks.
Bytes png_of(const Bytes& rows, std::size_t parts) {
  const Bytes data = packed(rows);
  Bytes out = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, head;
  put(head, width), put(head, height);
  head.insert(head.end(), {16, 0, 0, 0, 0});
  put_chunk(out, "IHDR", head);
  for (std::size_t k = 0; k < parts; ++k) {
    const std::size_t from = k * data.size() / parts, to = (k + 1) * data.size() / parts;
    put_chunk(out, "IDAT", ByteView(data).subspan(from, to - from));
  }
  put_chunk(out, "IEND", {});
  return out;
}

std::vector<std::uint16_t> decoded(const Bytes& png) {
  return recon::decode_png16(png, width, height);
}

Bytes resized(Bytes bytes, int more) {
  bytes.resize(static_cast<std::size_t>(std::ssize(bytes) + more));
  return bytes;
}

}  // namespace

TEST_CASE("the PNG decoder reads one or more image chunks for every filter type") {
  const auto many_levels = some_pixels();
  // Ties in the Paeth predictor occur only if neighbouring pixels differ by a few levels.
  std::vector<std::uint16_t> few_levels = many_levels;
  for (auto& v : few_levels) v = static_cast<std::uint16_t>(0x101 * (v % 5));
  for (const auto& pixels : {many_levels, few_levels})
    for (int first = 0; first < filters; ++first)
      for (const std::size_t parts : {1, 3})
        CHECK(decoded(png_of(filtered(pixels, first), parts)) == pixels);
}

TEST_CASE("the PNG decoder does not allocate more memory than the compressed data can fill") {
  CHECK(record::inflated(Bytes(100), std::numeric_limits<std::size_t>::max()).empty());
  const Bytes flat(1 << 20);
  // The decoder must accept data that have been compressed by a factor of a thousand.
  CHECK(record::inflated(packed(flat), flat.size()) == flat);
}

TEST_CASE("a PNG with an unknown filter, or with an extra or a missing byte, is refused") {
  const Bytes png = recon::encode_png16(some_pixels(), width, height);
  const Bytes rows = filtered(some_pixels(), 0);
  for (const int more : {1, -1}) {
    CHECK(decoded(resized(png, more)).empty());
    CHECK(decoded(png_of(resized(rows, more), 1)).empty());
  }
  CHECK(decoded(png_of(filtered(some_pixels(), filters), 1)).empty());
}

TEST_CASE("a PNG with a flipped bit gives the same image or is refused") {
  const auto pixels = some_pixels();
  const Bytes png = recon::encode_png16(pixels, width, height);
  REQUIRE(decoded(png) == pixels);
  std::size_t refused = 0;
  for (std::size_t bit = 0; bit < 8 * png.size(); ++bit) {
    Bytes damaged = png;
    damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ 1 << bit % 8);
    const auto found = decoded(damaged);
    if (!found.empty() && found != pixels) FAIL("bit " << bit << " makes another map");
    refused += found.empty();
  }
  CHECK(refused > 7 * png.size());
}
