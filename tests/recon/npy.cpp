// SPDX-License-Identifier: MIT
#include "recon/files/npy.hpp"

#include <fstream>

#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::Folder;

namespace {

// A version 1 file by hand: numpy.lib.format.
void write_npy(const std::string& path, std::string header, const std::string& values) {
  header.resize(118, ' ');
  header.back() = '\n';
  std::ofstream(path, std::ios::binary)
      << std::string("\x93NUMPY\x01\x00\x76\x00", 10) << header << values;
}

template <class T>
std::string raw(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

}  // namespace

TEST_CASE("arrays in C and in Fortran order, single and double") {
  const Folder dir;
  write_npy(dir / "c", "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }",
            raw<float>({1, 2, 3, 4, 5, 6}));
  write_npy(dir / "f", "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }",
            raw<double>({1, 4, 2, 5, 3, 6}));
  for (const char* name : {"c", "f"}) {
    const NpyArray a = read_npy(dir / name);
    CHECK(a.shape == std::vector<std::size_t>{2, 3});
    CHECK(a.values == std::vector<float>{1, 2, 3, 4, 5, 6});
  }
  write_npy(dir / "line", "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }",
            raw<float>({1, 2, 3}));
  CHECK(read_npy(dir / "line").shape == std::vector<std::size_t>{3});
}

TEST_CASE("what is not such an array is refused by name") {
  const Folder dir;
  const auto refused = [&](const std::string& name, const std::string& why) {
    CHECK_THROWS_WITH(read_npy(dir / name), Catch::Contains(dir / name) && Catch::Contains(why));
  };
  refused("missing", "No such file");
  std::ofstream(dir / "text") << "hello";
  refused("text", "not a NumPy array");
  write_npy(dir / "ints", "{'descr': '<i8', 'fortran_order': False, 'shape': (1,), }", "12345678");
  refused("ints", "'<i8'");
  write_npy(dir / "short", "{'descr': '<f4', 'fortran_order': False, 'shape': (9,), }", "12345678");
  refused("short", "asks for 36");
  write_npy(dir / "huge",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296), }",
            "1234");
  refused("huge", "asks for");
  write_npy(dir / "nan", "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }",
            raw<float>({1, std::nanf("")}));
  refused("nan", "value 1");
  const auto with_shape = [&](const std::string& name, const std::string& shape) {
    write_npy(dir / name, "{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + ", }",
              raw<float>({1, 2}));
    refused(name, "no shape that can be read");
  };
  with_shape("negative", "(-2,)");
  with_shape("words", "(two,)");
  with_shape("beyond", "(99999999999999999999999,)");
  with_shape("dots", "(2.0,)");
  with_shape("none", "2");
  std::string ones = "(";
  for (int i = 0; i < 33; ++i) ones += "1,";
  with_shape("deep", ones + ")");
  write_npy(dir / "order", "{'descr': '<f4', 'shape': (1,), }", raw<float>({1}));
  refused("order", "Fortran");
  write_npy(dir / "colour", "{'descr': '\x1b[2J', 'shape': (1,), }", raw<float>({1}));
  CHECK_THROWS_WITH(read_npy(dir / "colour"), !Catch::Contains("\x1b"));
  std::ofstream(dir / "long", std::ios::binary)
      << std::string("\x93NUMPY\x02\x00\xff\xff\xff\xff", 12);
  refused("long", "expected at most 65535");
  std::ofstream(dir / "nine", std::ios::binary) << std::string("\x93NUMPY\x09\x00\x10\x00", 10);
  refused("nine", "version 9");
  CHECK_THROWS_WITH(read_npy("/dev/zero"), Catch::Contains("/dev/zero: is a device"));
  std::ofstream(dir / "cut", std::ios::binary) << std::string("\x93NUMPY\x01\x00\xff\xff", 10);
  refused("cut", "cut off");
}
