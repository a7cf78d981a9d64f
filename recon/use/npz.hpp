// SPDX-License-Identifier: MIT
// This file writes NumPy's archive of arrays, for numpy.load: an uncompressed zip file of .npy
// files. It writes row by row, so that a run of any length needs no memory.
//   NpzFile out("maps.npz");
//   out.begin("depth_m", "<f4", {64, 64});  // rows of 64 x 64
//   out.append<float>(map);                 // one or more whole rows, as often as wanted
//   out.close();
// Sources: numpy.lib.format; PKWARE APPNOTE 6.3.10, sections 4.3.7 (local header), 4.3.12, 4.3.16.
#pragma once
#include <cstdint>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/program/atomic_write.hpp"

namespace echofuse::recon {

// Every member throws Error(disk) if a write fails, and Error(failed) beyond 4 GiB, which is where
// plain zip ends. A file that close() has not finished is removed.
class NpzFile {
 public:
  explicit NpzFile(const std::string& path);
  // It begins the next array and finishes the one before; `type` is as NumPy writes it ("<f4",
  // "<i8", "|u1").
  void begin(const std::string& name, const std::string& type,
             const std::vector<std::size_t>& row_shape);
  template <class T>
  void append(std::span<const T> values) {
    append_bytes({reinterpret_cast<const std::uint8_t*>(values.data()), values.size_bytes()});
  }
  template <class T>
  void append(const std::vector<T>& values) {
    append(std::span<const T>(values));
  }
  void close();

 private:
  struct Member {
    std::string name, type;
    std::vector<std::size_t> row_shape;
    std::uint64_t offset = 0, bytes = 0;  // place of the local header, and size of the values
    std::uint32_t crc = 0;                // CRC of the values, later of the whole member
  };
  void append_bytes(ByteView bytes);
  void finish();
  void write(ByteView bytes);
  void flush();

  std::string path_;
  UnfinishedFile file_;
  std::fstream out_;
  // They wait to be written: a system call for a single map takes as long as the map.
  Bytes waiting_;
  std::vector<Member> members_;
  bool finished_ = true;  // true if the last member is finished
};

}  // namespace echofuse::recon
