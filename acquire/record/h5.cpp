// SPDX-License-Identifier: MIT
#include "acquire/record/h5.hpp"

#include <hdf5_hl.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "acquire/record/h5_handle.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
namespace {

constexpr std::size_t smallest_compressed_row =
    64;  // bytes; a filter costs more than it saves below

// The innermost reason of the last failed call; that of the system alone, if it has one.
std::string reason() {
  std::string text;
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned, const H5E_error2_t* e, void* out) -> herr_t {
        *static_cast<std::string*>(out) = e->desc ? e->desc : "";
        return 1;
      },
      &text);
  const std::string begin = "error message = '";
  const std::size_t at = text.find(begin);
  if (at == text.npos) return text;
  text.erase(0, at + begin.size());
  return text.substr(0, text.find('\''));
}

Handle make_space(const H5Shape& shape) {
  const std::vector<hsize_t> sizes(shape.begin(), shape.end());
  return {shape.empty() ? H5Screate(H5S_SCALAR)
                        : H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr),
          H5Sclose};
}

// Texts one behind the other, all as long as the longest, with zeros behind them.
struct FixedTexts {
  explicit FixedTexts(const std::vector<std::string>& texts) {
    for (const auto& t : texts) length = std::max(length, t.size());
    for (const auto& t : texts) (bytes += t).append(length - t.size(), '\0');
    ascii = std::ranges::all_of(bytes, [](char c) { return c >= 0; });
  }
  std::size_t length = 1;
  std::string bytes;
  bool ascii = true;
};

}  // namespace

H5File H5File::create(const std::string& path) {
  quiet();
  if (::access(path.c_str(), F_OK) == 0)
    throw Error(ExitCode::failed, path + ": exists already; choose another name");
  H5File made(path, H5Fcreate(path.c_str(), H5F_ACC_EXCL, H5P_DEFAULT, H5P_DEFAULT));
  if (made.file_ < 0) made.fail("", "cannot create", true);
  return made;
}

H5File H5File::open(const std::string& path) {
  quiet();
  if (::access(path.c_str(), R_OK) != 0)
    throw Error(ExitCode::failed, path + ": no such file, or not readable; expected an HDF5 file");
  H5File opened(path, H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  if (opened.file_ < 0) opened.fail("", "not a readable HDF5 file", false);
  return opened;
}

H5File::~H5File() {
  if (file_ >= 0) H5Fclose(file_);
}

H5File::H5File(H5File&& other) noexcept
    : path_(std::move(other.path_)), file_(std::exchange(other.file_, -1)) {}

void H5File::close() {
  const hid_t file = std::exchange(file_, -1);
  if (file < 0) return;
  if (H5Fclose(file) < 0) fail("", "cannot finish writing", true);
}

// Of fixed length (zeros behind it), or H5T_VARIABLE. Octave reads ASCII only, if it is said to be.
std::int64_t H5File::text_type(std::size_t length, bool ascii) const {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, length);
  H5Tset_cset(type, ascii ? H5T_CSET_ASCII : H5T_CSET_UTF8);
  if (length != H5T_VARIABLE) H5Tset_strpad(type, H5T_STR_NULLPAD);
  return type;
}

void H5File::refuse(const std::string& object, const std::string& why) const {
  throw Error(ExitCode::failed, path_ + ": " + printable(object) + ": " + why);
}

void H5File::fail(const std::string& name, const char* what, bool writing) const {
  const std::string why = printable(reason());
  throw Error(writing ? ExitCode::disk : ExitCode::failed,
              path_ + (name.empty() ? "" : ": " + name) + ": " + what +
                  (why.empty() ? "" : " (" + why + ")"));
}

std::int64_t H5File::make_dataset(const std::string& name, std::int64_t type,
                                  const H5Shape& shape) {
  const Handle space = make_space(shape);
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links.get(), 1);
  const Handle layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const std::size_t values = product(shape);
  if (shape.size() >= 2 && values > 0 &&
      values / shape[0] * H5Tget_size(type) >= smallest_compressed_row) {
    std::vector<hsize_t> chunk(shape.begin(), shape.end());
    chunk[0] = 1;
    H5Pset_chunk(layout.get(), static_cast<int>(chunk.size()), chunk.data());
    H5Pset_shuffle(layout.get());
    H5Pset_deflate(layout.get(), 1);
  }
  const hid_t made =
      H5Dcreate2(file_, name.c_str(), type, space.get(), links.get(), layout.get(), H5P_DEFAULT);
  if (made < 0) fail(name, "cannot create the dataset", true);
  return made;
}

template <class T>
void H5File::write(const std::string& name, std::span<const T> values, const H5Shape& shape) {
  if (values.size() != product(shape)) fail(name, "shape and number of values differ", false);
  const Handle set(make_dataset(name, native<T>(), shape), H5Dclose);
  if (H5Dwrite(set.get(), native<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    fail(name, "cannot write", true);
}

template <class T>
void H5File::allocate(const std::string& name, const H5Shape& shape) {
  const Handle set(make_dataset(name, native<T>(), shape), H5Dclose);
}

template <class T>
void H5File::write_rows(const std::string& name, std::size_t first, std::span<const T> values) {
  const Handle set(dataset(name), H5Dclose);
  const H5Shape all = shape(name);
  const std::size_t row = all.empty() || all[0] == 0 ? 0 : product(all) / all[0];
  if (row == 0 || values.size() % row != 0 || first + values.size() / row > all[0])
    fail(name, "rows do not fit the dataset", false);
  std::vector<hsize_t> start(all.size(), 0), count(all.begin(), all.end());
  start[0] = first;
  count[0] = values.size() / row;
  const Handle file_space(H5Dget_space(set.get()), H5Sclose);
  const Handle memory_space(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                            H5Sclose);
  if (H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                          nullptr) < 0 ||
      H5Dwrite(set.get(), native<T>(), memory_space.get(), file_space.get(), H5P_DEFAULT,
               values.data()) < 0)
    fail(name, "cannot write", true);
}

void H5File::write_text(const std::string& name, const std::string& text) {
  write_strings(name, {text}, {});
}

void H5File::write_texts(const std::string& name, const std::vector<std::string>& texts) {
  write_strings(name, texts, {texts.size()});
}

void H5File::write_strings(const std::string& name, const std::vector<std::string>& texts,
                           const H5Shape& shape) {
  const FixedTexts fixed(texts);
  const Handle type(text_type(fixed.length, fixed.ascii), H5Tclose);
  const Handle set(make_dataset(name, type.get(), shape), H5Dclose);
  if (texts.empty()) return;
  if (H5Dwrite(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, fixed.bytes.data()) < 0)
    fail(name, "cannot write", true);
}

void H5File::make_group(const std::string& name) {
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links.get(), 1);
  const Handle group(H5Gcreate2(file_, name.c_str(), links.get(), H5P_DEFAULT, H5P_DEFAULT),
                     H5Gclose);
  if (!group.ok()) fail(name, "cannot create the group", true);
}

void H5File::link(const std::string& name, const std::string& dataset) {
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links.get(), 1);
  if (H5Lcreate_hard(file_, dataset.c_str(), file_, name.c_str(), links.get(), H5P_DEFAULT) < 0)
    fail(name, "cannot link", true);
}

void H5File::put_scale(const std::string& name, unsigned dimension, const std::string& scale) {
  const Handle set(dataset(name), H5Dclose), along(dataset(scale), H5Dclose);
  const std::string label = scale.substr(scale.rfind('/') + 1);
  if ((H5DSis_scale(along.get()) <= 0 && H5DSset_scale(along.get(), label.c_str()) < 0) ||
      H5DSattach_scale(set.get(), along.get(), dimension) < 0 ||
      H5DSset_label(set.get(), dimension, label.c_str()) < 0)
    fail(name, "cannot attach the scale of a dimension", true);
}

void H5File::set(const std::string& object, const std::string& attribute, const H5Value& value) {
  const auto* text = std::get_if<std::string>(&value);
  const auto* texts = std::get_if<std::vector<std::string>>(&value);
  std::vector<const char*> characters;
  if (text) characters.push_back(text->c_str());
  if (texts)
    for (const auto& each : *texts) characters.push_back(each.c_str());
  const Handle type(text || texts                           ? text_type(H5T_VARIABLE)
                    : std::holds_alternative<double>(value) ? H5Tcopy(H5T_NATIVE_DOUBLE)
                                                            : H5Tcopy(H5T_NATIVE_INT64),
                    H5Tclose);
  const void* raw = characters.data();
  if (const auto* number = std::get_if<double>(&value)) raw = number;
  if (const auto* number = std::get_if<std::int64_t>(&value)) raw = number;
  const Handle space = make_space(texts ? H5Shape{texts->size()} : H5Shape{});
  const Handle made(H5Acreate_by_name(file_, object.c_str(), attribute.c_str(), type.get(),
                                      space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose);
  if (!made.ok() || H5Awrite(made.get(), type.get(), raw) < 0)
    fail(object + "@" + attribute, "cannot write the attribute", true);
}

#define ECHOFUSE_H5_TYPE(T)                                                               \
  template void H5File::write<T>(const std::string&, std::span<const T>, const H5Shape&); \
  template void H5File::allocate<T>(const std::string&, const H5Shape&);                  \
  template void H5File::write_rows<T>(const std::string&, std::size_t, std::span<const T>);
ECHOFUSE_H5_TYPES(ECHOFUSE_H5_TYPE)
#undef ECHOFUSE_H5_TYPE

}  // namespace echofuse::record
