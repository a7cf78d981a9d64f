// SPDX-License-Identifier: MIT
#include "acquire/record/h5_out.hpp"

#include <hdf5.h>
#include <hdf5_hl.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>
#include <type_traits>
#include <utility>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
namespace {

static_assert(std::is_same_v<hid_t, std::int64_t>);

constexpr std::size_t smallest_compressed_row =
    64;                                          // bytes; a filter costs more than it saves below
constexpr std::size_t largest_chunk = 16 << 20;  // bytes; one is compressed in memory

// A handle of HDF5 and the call that gives it back.
class Handle {
 public:
  Handle(hid_t id, herr_t (*release)(hid_t)) : id_(id), release_(release) {}
  ~Handle() {
    if (id_ >= 0) release_(id_);
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  hid_t get() const { return id_; }

 private:
  hid_t id_;
  herr_t (*release_)(hid_t);
};

template <class T>
hid_t native() {
  if constexpr (std::is_same_v<T, float>) return H5T_NATIVE_FLOAT;
  if constexpr (std::is_same_v<T, double>) return H5T_NATIVE_DOUBLE;
  if constexpr (std::is_same_v<T, std::uint8_t>) return H5T_NATIVE_UINT8;
  if constexpr (std::is_same_v<T, std::uint32_t>) return H5T_NATIVE_UINT32;
  if constexpr (std::is_same_v<T, std::int64_t>) return H5T_NATIVE_INT64;
  if constexpr (std::is_same_v<T, std::uint64_t>) return H5T_NATIVE_UINT64;
}

std::size_t product(const H5Shape& shape) {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
}

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

// With groups on the way to it.
Handle with_groups() {
  const hid_t links = H5Pcreate(H5P_LINK_CREATE);
  H5Pset_create_intermediate_group(links, 1);
  return {links, H5Pclose};
}

// Of fixed length (zeros behind it), or H5T_VARIABLE. Octave reads ASCII only, if it is said to be.
hid_t text_type(std::size_t length, bool ascii = false) {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, length);
  H5Tset_cset(type, ascii ? H5T_CSET_ASCII : H5T_CSET_UTF8);
  if (length != H5T_VARIABLE) H5Tset_strpad(type, H5T_STR_NULLPAD);
  return type;
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

// HDF5 prints every failed call otherwise; ours are reported once, as Error. At the end of the
// process it would try again to write what a full disk did not take, and crash.
H5Out::H5Out(std::string path) : path_(std::move(path)), file_(-1) {
  H5dont_atexit();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  if (::access(path_.c_str(), F_OK) == 0) refuse("", "exists already; choose another name");
  file_ = H5Fcreate(path_.c_str(), H5F_ACC_EXCL, H5P_DEFAULT, H5P_DEFAULT);
  if (file_ < 0) fail("", "cannot create");
}

H5Out::~H5Out() {
  if (file_ >= 0) H5Fclose(file_);
}

void H5Out::close() {
  if (H5Fclose(std::exchange(file_, -1)) < 0) fail("", "cannot finish writing");
}

void H5Out::refuse(const std::string& name, const char* why) const {
  throw Error(ExitCode::failed, path_ + ": " + name + (name.empty() ? "" : ": ") + why);
}

void H5Out::fail(const std::string& name, const char* what) const {
  const std::string why = printable(reason());
  throw Error(ExitCode::disk, path_ + (name.empty() ? "" : ": " + name) + ": " + what +
                                  (why.empty() ? "" : " (" + why + ")"));
}

bool H5Out::has(const std::string& name) const {
  // HDF5 wants each group on the way asked for first.
  for (std::size_t slash = name.find('/', 1); slash != std::string::npos;
       slash = name.find('/', slash + 1))
    if (H5Lexists(file_, name.substr(0, slash).c_str(), H5P_DEFAULT) <= 0) return false;
  return H5Lexists(file_, name.c_str(), H5P_DEFAULT) > 0;
}

std::int64_t H5Out::dataset(const std::string& name) const {
  const hid_t opened = H5Dopen2(file_, name.c_str(), H5P_DEFAULT);
  if (opened < 0) refuse(name, "no such dataset");
  return opened;
}

std::int64_t H5Out::make_dataset(const std::string& name, std::int64_t type, const H5Shape& shape) {
  const Handle space = make_space(shape);
  const Handle links = with_groups();
  const Handle layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const std::size_t values = product(shape);
  if (shape.size() >= 2 && values > 0 &&
      values / shape[0] * H5Tget_size(type) >= smallest_compressed_row) {
    std::vector<hsize_t> chunk(shape.begin(), shape.end());
    chunk[0] = 1;
    const std::size_t line = values / shape[0] / shape[1] * H5Tget_size(type);
    chunk[1] = std::clamp<hsize_t>(largest_chunk / line, 1, shape[1]);
    H5Pset_chunk(layout.get(), static_cast<int>(chunk.size()), chunk.data());
    H5Pset_shuffle(layout.get());
    H5Pset_deflate(layout.get(), 1);
  }
  const float none = std::numeric_limits<float>::quiet_NaN();
  if (H5Tequal(type, H5T_NATIVE_FLOAT) > 0)
    H5Pset_fill_value(layout.get(), H5T_NATIVE_FLOAT, &none);  // rows that are not written
  const hid_t made =
      H5Dcreate2(file_, name.c_str(), type, space.get(), links.get(), layout.get(), H5P_DEFAULT);
  if (made < 0) fail(name, "cannot create the dataset");
  return made;
}

template <class T>
void H5Out::write(const std::string& name, const std::vector<T>& values, const H5Shape& shape) {
  if (values.size() != product(shape)) refuse(name, "shape and number of values differ");
  const Handle set(make_dataset(name, native<T>(), shape), H5Dclose);
  if (H5Dwrite(set.get(), native<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    fail(name, "cannot write");
}

template <class T>
void H5Out::allocate(const std::string& name, const H5Shape& shape) {
  const Handle set(make_dataset(name, native<T>(), shape), H5Dclose);
}

template <class T>
void H5Out::write_row(const std::string& name, std::size_t row, std::span<const T> values) {
  const Handle set(dataset(name), H5Dclose);
  const Handle all(H5Dget_space(set.get()), H5Sclose);
  std::vector<hsize_t> start(static_cast<std::size_t>(H5Sget_simple_extent_ndims(all.get())), 0),
      count(start);
  H5Sget_simple_extent_dims(all.get(), count.data(), nullptr);
  const hsize_t rows = std::exchange(count[0], 1);
  if (row >= rows || values.size() != product({count.begin(), count.end()}))
    refuse(name, "the row does not fit the dataset");
  start[0] = row;
  const Handle one(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                   H5Sclose);
  if (H5Sselect_hyperslab(all.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) <
          0 ||
      H5Dwrite(set.get(), native<T>(), one.get(), all.get(), H5P_DEFAULT, values.data()) < 0)
    fail(name, "cannot write");
}

void H5Out::write_text(const std::string& name, const std::string& text) {
  write_strings(name, {text}, {});
}

void H5Out::write_texts(const std::string& name, const std::vector<std::string>& texts) {
  write_strings(name, texts, {texts.size()});
}

void H5Out::write_strings(const std::string& name, const std::vector<std::string>& texts,
                          const H5Shape& shape) {
  const FixedTexts fixed(texts);
  const Handle type(text_type(fixed.length, fixed.ascii), H5Tclose);
  const Handle set(make_dataset(name, type.get(), shape), H5Dclose);
  if (texts.empty()) return;
  if (H5Dwrite(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, fixed.bytes.data()) < 0)
    fail(name, "cannot write");
}

void H5Out::make_group(const std::string& name) {
  const Handle links = with_groups();
  const Handle group(H5Gcreate2(file_, name.c_str(), links.get(), H5P_DEFAULT, H5P_DEFAULT),
                     H5Gclose);
  if (group.get() < 0) fail(name, "cannot create the group");
}

void H5Out::link(const std::string& name, const std::string& dataset) {
  const Handle links = with_groups();
  if (H5Lcreate_hard(file_, dataset.c_str(), file_, name.c_str(), links.get(), H5P_DEFAULT) < 0)
    fail(name, "cannot link");
}

void H5Out::put_scale(const std::string& name, unsigned dimension, const std::string& scale) {
  const Handle set(dataset(name), H5Dclose), along(dataset(scale), H5Dclose);
  const std::string label = scale.substr(scale.rfind('/') + 1);
  if ((H5DSis_scale(along.get()) <= 0 && H5DSset_scale(along.get(), label.c_str()) < 0) ||
      H5DSattach_scale(set.get(), along.get(), dimension) < 0 ||
      H5DSset_label(set.get(), dimension, label.c_str()) < 0)
    fail(name, "cannot attach the scale of a dimension");
}

void H5Out::set(const std::string& object, const std::string& attribute, const H5Value& value) {
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
  if (made.get() < 0 || H5Awrite(made.get(), type.get(), raw) < 0)
    fail(object + "@" + attribute, "cannot write the attribute");
}

#define ECHOFUSE_H5_TYPE(T)                                                                 \
  template void H5Out::write<T>(const std::string&, const std::vector<T>&, const H5Shape&); \
  template void H5Out::allocate<T>(const std::string&, const H5Shape&);                     \
  template void H5Out::write_row<T>(const std::string&, std::size_t, std::span<const T>);
ECHOFUSE_H5_TYPE(float)
ECHOFUSE_H5_TYPE(double)
ECHOFUSE_H5_TYPE(std::uint8_t)
ECHOFUSE_H5_TYPE(std::uint32_t)
ECHOFUSE_H5_TYPE(std::int64_t)
ECHOFUSE_H5_TYPE(std::uint64_t)
#undef ECHOFUSE_H5_TYPE

}  // namespace echofuse::record
