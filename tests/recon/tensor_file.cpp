// SPDX-License-Identifier: MIT
#include "recon/numbers/tensor_file.hpp"

#include <sys/resource.h>

#include "../catch.hpp"
#include "crafted.hpp"

TEST_CASE("overlapping tensors in a model file are refused before they are copied") {
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
  // The limit is 256 MiB. If all tensors were copied, the program would use 3 GB.
  CHECK(peak_kib() - before < 256 << 10);
}

TEST_CASE("a tensor shape is refused if its size in bytes overflows 64 bits") {
  nlohmann::json head;
  head["__metadata__"] = {{"crc32c", "00000000"}, {"facts", "{}"}};
  // The tensor size, 4 * (2^62 + 2) bytes, equals 8 modulo 2^64.
  const std::uint64_t values = (std::uint64_t{1} << 62) + 2;
  head["t"] = {{"dtype", "F32"}, {"shape", {values}}, {"data_offsets", {0, 8}}};
  CHECK_THROWS_WITH(recon::TensorFile("crafted", crafted::sealed(head.dump(), Bytes(8))),
                    Catch::Contains("t: the data size does not match the shape"));
}
