// SPDX-License-Identifier: MIT
#include "recon/numbers/tensor_file.hpp"

#include <sys/resource.h>

#include <catch2/catch.hpp>

#include "crafted.hpp"

using namespace echofuse;

TEST_CASE("overlapping tensors are refused before copying") {
  const std::size_t size = 1 << 20;
  nlohmann::json head;
  head["__metadata__"] = {{"crc32c", "00000000"}, {"facts", "{}"}};
  for (int i = 0; i < 3000; ++i)
    head["t" + std::to_string(i)] = {
        {"dtype", "U8"}, {"shape", {size}}, {"data_offsets", {0, size}}};
  const Bytes file = crafted::sealed(head.dump(), Bytes(size));
  const auto peak_kib = [] {
    rusage used{};
    ::getrusage(RUSAGE_SELF, &used);
    return used.ru_maxrss;
  };
  const auto before = peak_kib();
  CHECK_THROWS_WITH(recon::TensorFile("crafted", file),
                    Catch::Contains("data_offsets: tensors overlap or leave a gap"));
  CHECK(peak_kib() - before < 256 << 10);  // copies would take 3 GB
}

TEST_CASE("a tensor shape that overflows is refused") {
  nlohmann::json head;
  head["__metadata__"] = {{"crc32c", "00000000"}, {"facts", "{}"}};
  const std::uint64_t values = (std::uint64_t{1} << 62) + 2;  // in bytes: 8, modulo 2^64
  head["t"] = {{"dtype", "F32"}, {"shape", {values}}, {"data_offsets", {0, 8}}};
  CHECK_THROWS_WITH(recon::TensorFile("crafted", crafted::sealed(head.dump(), Bytes(8))),
                    Catch::Contains("t: data size does not match shape"));
}
