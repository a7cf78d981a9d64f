// SPDX-License-Identifier: MIT
// Sealed files: the checksum in front, and the structure behind it (h5.hpp).
#include <fcntl.h>
#include <libdeflate.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "acquire/record/h5_handle.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/regular_file.hpp"

namespace echofuse::record {
namespace {

constexpr const char* magic = "ECHOFUSE";
constexpr std::uint32_t seal_version = 1;
constexpr std::size_t most_bytes = std::size_t{1} << 30;
constexpr std::size_t most_objects = 4096, most_attributes = 64, most_depth = 8, most_rank = 4;
constexpr std::size_t longest_name = 64, longest_attribute = 4096;

[[noreturn]] void refuse_file(const std::string& path, const std::string& why) {
  throw Error(ExitCode::failed, path + ": " + why);
}

bool write_at_start(const std::string& path, ByteView bytes) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  const bool good =
      fd >= 0 && ::pwrite(fd, bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size());
  const int reason = errno;
  if (fd >= 0) ::close(fd);
  errno = reason;
  return good;
}

std::uint32_t checksum(ByteView bytes, std::uint32_t before = 0) {
  return ::libdeflate_crc32(before, bytes.data(), bytes.size());
}

Bytes make_seal(std::uint32_t crc, std::size_t length) {
  Bytes out(magic, magic + std::strlen(magic));
  put(out, seal_version);
  put(out, crc);
  put(out, std::uint64_t{length});
  out.resize(seal_bytes);
  return out;
}

// Of the first bytes of a file that has so many in all.
void check_head(ByteView head, std::size_t length, const std::string& path) {
  ByteReader in(head);
  const ByteView found = in.take(std::strlen(magic));
  if (found.empty() || !std::equal(found.begin(), found.end(), magic)) {
    const bool hdf5 = head.size() >= 8 && std::memcmp(head.data(), "\x89HDF\r\n\x1a\n", 8) == 0;
    refuse_file(path, hdf5 ? "an HDF5 file without a checksum; a model of an older echofuse must "
                             "be trained again"
                           : "not an echofuse model file or checkpoint");
  }
  const auto version = in.get<std::uint32_t>();
  in.get<std::uint32_t>();
  const auto said = in.get<std::uint64_t>();
  if (version != seal_version)
    refuse_file(path, "sealed in version " + std::to_string(version) + "; expected version " +
                          std::to_string(seal_version) + ": use a newer echofuse");
  if (head.size() < seal_bytes || said != length)
    refuse_file(path, "has " + std::to_string(length) + " bytes; expected " + std::to_string(said) +
                          ": it was cut off or changed");
  if (length > most_bytes)
    refuse_file(path, "has " + std::to_string(length) + " bytes; expected at most " +
                          std::to_string(most_bytes));
}

void check_sum(ByteView all, const std::string& path) {
  if (std::equal(all.begin(), all.begin() + seal_bytes,
                 make_seal(checksum(all.subspan(seal_bytes)), all.size()).begin()))
    return;
  refuse_file(path, "is damaged: its checksum is another one; copy it again or train it again");
}

bool is_one_of(hid_t type, const std::vector<hid_t>& known) {
  return std::any_of(known.begin(), known.end(), [&](hid_t k) { return H5Tequal(type, k) > 0; });
}

bool is_number(hid_t type) {
  return is_one_of(type, {H5T_IEEE_F32LE, H5T_IEEE_F64LE, H5T_STD_I8LE, H5T_STD_U8LE, H5T_STD_U16LE,
                          H5T_STD_U32LE, H5T_STD_I32LE, H5T_STD_I64LE, H5T_STD_U64LE});
}

bool is_fixed_text(hid_t type) {
  return H5Tget_class(type) == H5T_STRING && H5Tis_variable_str(type) == 0;
}

bool is_plain(const std::string& name) {
  return !name.empty() && name.size() <= longest_name &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '_' || c == '-';
         });
}

// What HDF5 makes of the file, before any of it is used.
class Inspection {
 public:
  Inspection(const H5File& file, std::size_t bytes) : file_(file), left_(bytes), bytes_(bytes) {}

  void group(hid_t group, const std::string& name, std::size_t depth = 0) {
    if (depth > most_depth) file_.refuse(name, "lies too deep; expected 8 groups at most");
    for (const std::string& link : links(group, name)) {
      const std::string path = name.empty() ? link : name + "/" + link;
      H5O_info_t info;
      if (H5Oget_info_by_name(group, link.c_str(), &info, H5P_DEFAULT) < 0)
        file_.refuse(path, "cannot be read");
      if (info.rc != 1 || !seen_.insert(info.addr).second)
        file_.refuse(path, "is linked more than once; expected each object in one place");
      if (seen_.size() > most_objects) file_.refuse(path, "is one object too many");
      const Handle object(H5Oopen(group, link.c_str(), H5P_DEFAULT), H5Oclose);
      if (!object.ok()) file_.refuse(path, "cannot be opened");
      attributes(object.get(), path);
      if (info.type == H5O_TYPE_GROUP)
        this->group(object.get(), path, depth + 1);
      else if (info.type == H5O_TYPE_DATASET)
        dataset(object.get(), path);
      else
        file_.refuse(path, "is neither a group nor an array");
    }
  }
  void root(hid_t file) {
    H5O_info_t info;
    const Handle top(H5Gopen2(file, "/", H5P_DEFAULT), H5Gclose);
    if (!top.ok() || H5Oget_info(top.get(), &info) < 0) file_.refuse("/", "cannot be read");
    seen_.insert(info.addr);
    attributes(top.get(), ".");
    group(top.get(), "");
  }

 private:
  std::vector<std::string> links(hid_t group, const std::string& name) {
    struct Found {
      std::vector<std::string> names;
      bool hard = true;
    } found;
    const auto take = [](hid_t, const char* link, const H5L_info_t* info, void* out) -> herr_t {
      auto& all = *static_cast<Found*>(out);
      all.names.emplace_back(link);
      all.hard = info->type == H5L_TYPE_HARD;
      return all.hard && is_plain(all.names.back()) && all.names.size() <= most_objects ? 0 : 1;
    };
    const herr_t result = H5Literate(group, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, take, &found);
    const std::string place = name.empty() ? "/" : name;
    if (result < 0) file_.refuse(place, "cannot be listed");
    if (result == 0) return std::move(found.names);
    if (!found.hard)
      file_.refuse(place + "/" + found.names.back(),
                   "is a soft or external link; expected a group or an array");
    file_.refuse(place, "holds a name that is none of a model, or too many");
  }

  void attributes(hid_t object, const std::string& name) {
    const int count = H5Aget_num_attrs(object);
    if (count < 0 || static_cast<std::size_t>(count) > most_attributes)
      file_.refuse(name, "has too many attributes");
    for (int i = 0; i < count; ++i) {
      const Handle one(H5Aopen_by_idx(object, ".", H5_INDEX_NAME, H5_ITER_NATIVE,
                                      static_cast<hsize_t>(i), H5P_DEFAULT, H5P_DEFAULT),
                       H5Aclose);
      if (!one.ok()) file_.refuse(name, "has an attribute that cannot be read");
      std::string title(longest_name + 1, '\0');
      const ssize_t length = H5Aget_name(one.get(), title.size(), title.data());
      title.resize(std::clamp<std::size_t>(static_cast<std::size_t>(length), 0, longest_name));
      if (length < 0 || !is_plain(title.c_str()))
        file_.refuse(name, "has an attribute whose name is none of a model");
      const Handle type(H5Aget_type(one.get()), H5Tclose), space(H5Aget_space(one.get()), H5Sclose);
      if (H5Sget_simple_extent_type(space.get()) != H5S_SCALAR ||
          !(is_number(type.get()) || is_fixed_text(type.get())) ||
          H5Tget_size(type.get()) > longest_attribute)
        file_.refuse(name + "@" + title,
                     "expected one number, or one text of at most 4096 bytes and fixed length");
    }
  }

  void dataset(hid_t set, const std::string& name) {
    const Handle type(H5Dget_type(set), H5Tclose), space(H5Dget_space(set), H5Sclose);
    const Handle how(H5Dget_create_plist(set), H5Pclose);
    if (!is_number(type.get()) && !is_fixed_text(type.get()))
      file_.refuse(name, "holds neither numbers nor texts of fixed length");
    if (H5Pget_layout(how.get()) != H5D_CONTIGUOUS || H5Pget_external_count(how.get()) != 0)
      file_.refuse(name, "is not stored in one piece within the file");
    const H5S_class_t kind = H5Sget_simple_extent_type(space.get());
    const H5Shape shape = shape_of(space.get());
    if ((kind != H5S_SIMPLE && kind != H5S_SCALAR) || shape.size() > most_rank)
      file_.refuse(name, "is no array of at most 4 dimensions");
    std::size_t wanted = H5Tget_size(type.get());
    for (const std::size_t n : shape) {  // what is larger than the file overflows nothing
      if (n == 0) return;
      wanted = wanted <= bytes_ / n ? wanted * n : bytes_ + 1;
    }
    const haddr_t at = H5Dget_offset(set);
    if (wanted > left_ || H5Dget_storage_size(set) != wanted || at == HADDR_UNDEF ||
        at > bytes_ - wanted)
      file_.refuse(name, "asks for more values than the file holds");
    left_ -= wanted;
  }

  const H5File& file_;
  std::size_t left_, bytes_;  // not yet claimed by an array; of the file
  std::set<haddr_t> seen_;
};

}  // namespace

void H5File::seal(const std::string& path) {
  const RegularFile file(path, ExitCode::disk);
  std::size_t left = file.size();
  const std::size_t length = left;
  if (length > most_bytes)
    throw Error(ExitCode::failed,
                path + ": has " + std::to_string(length) + " bytes; at most " +
                    std::to_string(most_bytes) +
                    " can be read again: use fewer records, or a model that keeps "
                    "none of them");
  Bytes part(std::size_t{1} << 16);
  bool good = length >= seal_bytes && file.read(std::span(part).first(seal_bytes)) == seal_bytes;
  std::uint32_t crc = 0;
  for (left -= good ? seal_bytes : 0; good && left > 0;) {
    const auto some = std::span(part).first(std::min(left, part.size()));
    good = file.read(some) == some.size();
    crc = checksum(some, crc);
    left -= some.size();
  }
  if (!good || !write_at_start(path, make_seal(crc, length)))
    throw Error(ExitCode::disk, path + ": cannot seal: " + std::strerror(errno));
}

H5File H5File::open_sealed(const std::string& path) {
  const RegularFile file(path, ExitCode::failed);
  const std::size_t length = file.size();
  Bytes contents(std::min(length, seal_bytes));
  file.read(contents);
  check_head(contents, length, path);
  contents.resize(length);
  if (file.read(std::span(contents).subspan(seal_bytes)) < length - seal_bytes)
    refuse_file(path, "became shorter while it was read");
  return open_sealed(path, std::move(contents));
}

H5File H5File::open_sealed(const std::string& path, Bytes contents) {
  quiet();
  check_head(ByteView(contents).first(std::min(contents.size(), seal_bytes)), contents.size(),
             path);
  check_sum(contents, path);
  const std::size_t bytes = contents.size();
  const Handle how(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fapl_core(how.get(), std::size_t{1} << 16, false);
  H5Pset_file_image(how.get(), contents.data(), contents.size());
  contents = {};  // HDF5 has a copy
  H5File opened(path, H5Fopen("sealed", H5F_ACC_RDONLY, how.get()), true);
  if (opened.file_ < 0) opened.fail("", "not a readable HDF5 file", false);
  Inspection(opened, bytes).root(opened.file_);
  return opened;
}

}  // namespace echofuse::record
