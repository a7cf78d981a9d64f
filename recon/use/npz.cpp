// SPDX-License-Identifier: MIT
#include "recon/use/npz.hpp"

#include <libdeflate.h>
#include <zlib.h>

#include <cerrno>
#include <cstdlib>
#include <limits>

#include "drivers/program/exit_code.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t npy_header_bytes = 128;  // room for the number of rows, known last
constexpr std::size_t local_header_bytes = 30;

ByteView view(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string npy_header(const std::string& type, std::uint64_t rows,
                       const std::vector<std::size_t>& row_shape) {
  std::string shape = formatted("%llu,", static_cast<unsigned long long>(rows));
  for (const std::size_t n : row_shape) shape += formatted(" %zu,", n);
  // This is version 1.0, and the length of what follows.
  std::string out("\x93NUMPY\x01\x00\x76\x00", 10);
  out += formatted("{'descr': '%s', 'fortran_order': False, 'shape': (%s), }", type.c_str(),
                   shape.c_str());
  out.resize(npy_header_bytes - 1, ' ');
  out += '\n';
  return out;
}

std::uint32_t crc_of(ByteView bytes, std::uint32_t before = 0) {
  return ::libdeflate_crc32(before, bytes.data(), bytes.size());
}

// These are the fields that the local and the central header have in common, from the needed
// version to the name's length. The file is stored, and has no time, which is 1980-01-01.
void put_facts(Bytes& out, std::uint32_t crc, std::uint64_t size, const std::string& file) {
  for (const int v : {20, 0, 0, 0, 33}) put(out, static_cast<std::uint16_t>(v));
  put(out, crc);
  for (int i = 0; i < 2; ++i) put(out, static_cast<std::uint32_t>(size));
  put(out, static_cast<std::uint16_t>(file.size()));
  put(out, std::uint16_t{0});
}

}  // namespace

NpzFile::NpzFile(const std::string& path)
    : path_(path),
      file_(path),
      out_(file_.path(), std::ios::binary | std::ios::in | std::ios::out) {
  flush();
}

void NpzFile::write(ByteView bytes) {
  constexpr std::size_t at_once = std::size_t{1} << 18;
  waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
  if (waiting_.size() >= at_once) flush();
}

void NpzFile::flush() {
  out_.write(reinterpret_cast<const char*>(waiting_.data()),
             static_cast<std::streamsize>(waiting_.size()));
  waiting_.clear();
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
}

void NpzFile::begin(const std::string& name, const std::string& type,
                    const std::vector<std::size_t>& row_shape) {
  finish();
  Member m{name + ".npy", type, row_shape, static_cast<std::uint64_t>(out_.tellp()), 0, 0};
  write(Bytes(local_header_bytes + m.name.size() + npy_header_bytes));
  members_.push_back(std::move(m));
  finished_ = false;
}

void NpzFile::append_bytes(ByteView bytes) {
  Member& m = members_.back();
  constexpr std::uint64_t room = std::numeric_limits<std::uint32_t>::max() - (1u << 20);
  if (m.offset + m.bytes + bytes.size() > room)
    throw Error(ExitCode::failed, path_ + ": an .npz file holds at most 4 GiB");
  write(bytes);
  m.bytes += bytes.size();
  m.crc = crc_of(bytes, m.crc);
}

// It goes back to fill in what is known only now: the number of rows, sizes and checksum. By then
// no bytes wait to be written.
void NpzFile::finish() {
  if (finished_) return;
  finished_ = true;
  Member& m = members_.back();
  std::uint64_t row_bytes = std::strtoull(m.type.c_str() + 2, nullptr, 10);
  for (const std::size_t n : m.row_shape) row_bytes *= n;
  const std::string npy = npy_header(m.type, m.bytes / row_bytes, m.row_shape);
  m.crc = static_cast<std::uint32_t>(
      ::crc32_combine(crc_of(view(npy)), m.crc, static_cast<z_off_t>(m.bytes)));
  m.bytes += npy.size();
  Bytes head;
  put(head, std::uint32_t{0x04034b50});
  put_facts(head, m.crc, m.bytes, m.name);
  flush();
  out_.seekp(static_cast<std::streamoff>(m.offset));
  write(head);
  write(view(m.name));
  write(view(npy));
  flush();
  out_.seekp(0, std::ios::end);
}

void NpzFile::close() {
  finish();
  const auto first = static_cast<std::uint32_t>(out_.tellp());
  Bytes tail;
  for (const Member& m : members_) {
    put(tail, std::uint32_t{0x02014b50});
    put(tail, std::uint16_t{20});
    put_facts(tail, m.crc, m.bytes, m.name);
    tail.resize(tail.size() + 10);  // no comment, disk 0, no attributes
    put(tail, static_cast<std::uint32_t>(m.offset));
    tail.insert(tail.end(), m.name.begin(), m.name.end());
  }
  const auto bytes = static_cast<std::uint32_t>(tail.size());
  const auto count = static_cast<std::uint16_t>(members_.size());
  put(tail, std::uint32_t{0x06054b50});
  put(tail, std::uint32_t{0});
  put(tail, count);
  put(tail, count);
  put(tail, bytes);
  put(tail, first);
  put(tail, std::uint16_t{0});
  write(tail);
  flush();
  out_.close();
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
  file_.publish();
}

}  // namespace echofuse::recon
