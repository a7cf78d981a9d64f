// SPDX-License-Identifier: MIT
#include "acquire/record/h5.hpp"

#include <hdf5.h>
#include <unistd.h>

#include <functional>
#include <numeric>
#include <type_traits>
#include <utility>

#include "drivers/core/exit_code.hpp"

namespace echofuse::record {
namespace {

static_assert(std::is_same_v<hid_t, std::int64_t>);
constexpr std::size_t smallest_compressed_row =
    64;  // bytes; a filter costs more than it saves below

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
  bool ok() const { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*release_)(hid_t);
};

template <class T>
hid_t native() {
  if constexpr (std::is_same_v<T, float>)
    return H5T_NATIVE_FLOAT;
  else if constexpr (std::is_same_v<T, double>)
    return H5T_NATIVE_DOUBLE;
  else if constexpr (std::is_same_v<T, std::int8_t>)
    return H5T_NATIVE_INT8;
  else if constexpr (std::is_same_v<T, std::uint8_t>)
    return H5T_NATIVE_UINT8;
  else if constexpr (std::is_same_v<T, std::uint16_t>)
    return H5T_NATIVE_UINT16;
  else if constexpr (std::is_same_v<T, std::uint32_t>)
    return H5T_NATIVE_UINT32;
  else if constexpr (std::is_same_v<T, std::int32_t>)
    return H5T_NATIVE_INT32;
  else if constexpr (std::is_same_v<T, std::int64_t>)
    return H5T_NATIVE_INT64;
  else
    return H5T_NATIVE_UINT64;
}

// The variable-length UTF-8 text that h5py and MATLAB read as a string.
hid_t make_text_type() {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

// HDF5 prints every failed call otherwise; ours are reported once, as Error.
void quiet() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

// The innermost reason of the last failed call.
std::string reason() {
  std::string text;
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned, const H5E_error2_t* e, void* out) -> herr_t {
        *static_cast<std::string*>(out) = e->desc ? e->desc : "";
        return 1;
      },
      &text);
  return text;
}

std::size_t product(const H5Shape& shape) {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
}

herr_t release(hid_t file) {
  return H5Iget_type(file) == H5I_GROUP ? H5Gclose(file) : H5Fclose(file);
}

Handle make_space(const H5Shape& shape) {
  const std::vector<hsize_t> sizes(shape.begin(), shape.end());
  return {shape.empty() ? H5Screate(H5S_SCALAR)
                        : H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr),
          H5Sclose};
}

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

H5File H5File::group(const std::string& name) const {
  const hid_t found = has(name)
                          ? H5Gopen2(file_, name.c_str(), H5P_DEFAULT)
                          : H5Gcreate2(file_, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  if (found < 0) fail(name, "no such group", false);
  return {path_, found};
}

H5File::~H5File() {
  if (file_ >= 0) release(file_);
}

H5File::H5File(H5File&& other) noexcept
    : path_(std::move(other.path_)), file_(std::exchange(other.file_, -1)) {}

void H5File::close() {
  const hid_t file = std::exchange(file_, -1);
  if (file >= 0 && release(file) < 0) fail("", "cannot finish writing", true);
}

void H5File::fail(const std::string& name, const char* what, bool writing) const {
  const std::string why = reason();
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
  const Handle type(make_text_type(), H5Tclose);
  const Handle set(make_dataset(name, type.get(), {}), H5Dclose);
  const char* raw = text.c_str();
  if (H5Dwrite(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, &raw) < 0)
    fail(name, "cannot write", true);
}

void H5File::write_texts(const std::string& name, const std::vector<std::string>& texts) {
  const Handle type(make_text_type(), H5Tclose);
  const Handle set(make_dataset(name, type.get(), {texts.size()}), H5Dclose);
  std::vector<const char*> raw;
  for (const auto& t : texts) raw.push_back(t.c_str());
  if (!raw.empty() &&
      H5Dwrite(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) < 0)
    fail(name, "cannot write", true);
}

void H5File::make_group(const std::string& name) {
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links.get(), 1);
  const Handle group(H5Gcreate2(file_, name.c_str(), links.get(), H5P_DEFAULT, H5P_DEFAULT),
                     H5Gclose);
  if (!group.ok()) fail(name, "cannot create the group", true);
}

void H5File::set(const std::string& object, const std::string& attribute, const H5Value& value) {
  const Handle text_type(make_text_type(), H5Tclose);
  hid_t type = text_type.get();
  const char* text = nullptr;
  const void* raw = &text;
  if (const auto* s = std::get_if<std::string>(&value)) {
    text = s->c_str();
  } else if (const auto* d = std::get_if<double>(&value)) {
    type = H5T_NATIVE_DOUBLE;
    raw = d;
  } else {
    type = H5T_NATIVE_INT64;
    raw = &std::get<std::int64_t>(value);
  }
  const Handle space = make_space({});
  const Handle made(H5Acreate_by_name(file_, object.c_str(), attribute.c_str(), type, space.get(),
                                      H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose);
  if (!made.ok() || H5Awrite(made.get(), type, raw) < 0)
    fail(object + "@" + attribute, "cannot write the attribute", true);
}

bool H5File::has(const std::string& name) const {
  // HDF5 wants each group on the way asked for first.
  for (std::size_t slash = name.find('/', 1); slash != std::string::npos;
       slash = name.find('/', slash + 1))
    if (H5Lexists(file_, name.substr(0, slash).c_str(), H5P_DEFAULT) <= 0) return false;
  return H5Lexists(file_, name.c_str(), H5P_DEFAULT) > 0;
}

std::int64_t H5File::dataset(const std::string& name) const {
  const hid_t opened = H5Dopen2(file_, name.c_str(), H5P_DEFAULT);
  if (opened < 0) fail(name, "no such dataset", false);
  return opened;
}

H5Shape H5File::shape(const std::string& name) const {
  const Handle set(dataset(name), H5Dclose);
  const Handle space(H5Dget_space(set.get()), H5Sclose);
  const int rank = H5Sget_simple_extent_ndims(space.get());
  std::vector<hsize_t> sizes(rank > 0 ? static_cast<std::size_t>(rank) : 0);
  if (rank > 0) H5Sget_simple_extent_dims(space.get(), sizes.data(), nullptr);
  return {sizes.begin(), sizes.end()};
}

template <class T>
std::vector<T> H5File::read(const std::string& name) const {
  std::vector<T> values(product(shape(name)));
  const Handle set(dataset(name), H5Dclose);
  if (H5Dread(set.get(), native<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    fail(name, "cannot read as numbers", false);
  return values;
}

std::vector<std::string> H5File::read_texts(const std::string& name) const {
  std::vector<char*> raw(product(shape(name)), nullptr);
  const Handle set(dataset(name), H5Dclose);
  const Handle type(make_text_type(), H5Tclose);
  if (!raw.empty() && H5Dread(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) < 0)
    fail(name, "cannot read as texts", false);
  std::vector<std::string> texts;
  for (char* t : raw) {
    texts.emplace_back(t ? t : "");
    H5free_memory(t);
  }
  return texts;
}

std::string H5File::read_text(const std::string& name) const {
  const auto texts = read_texts(name);
  if (texts.size() != 1) fail(name, "expected one text", false);
  return texts[0];
}

bool H5File::has_attribute(const std::string& object, const std::string& attribute) const {
  return (object == "." || object == "/" || has(object)) &&
         H5Aexists_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT) > 0;
}

template <class T>
T H5File::get(const std::string& object, const std::string& attribute) const {
  const Handle found(
      H5Aopen_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT),
      H5Aclose);
  const std::string place = object + "@" + attribute;
  if (!found.ok()) fail(place, "no such attribute", false);
  if constexpr (std::is_same_v<T, std::string>) {
    const Handle type(make_text_type(), H5Tclose);
    char* raw = nullptr;
    if (H5Aread(found.get(), type.get(), &raw) < 0) fail(place, "cannot read as a text", false);
    std::string text = raw ? raw : "";
    H5free_memory(raw);
    return text;
  } else {
    T value{};
    if (H5Aread(found.get(), native<T>(), &value) < 0)
      fail(place, "cannot read as a number", false);
    return value;
  }
}

template std::string H5File::get(const std::string&, const std::string&) const;
template double H5File::get(const std::string&, const std::string&) const;
template std::int64_t H5File::get(const std::string&, const std::string&) const;

#define ECHOFUSE_H5_TYPE(T)                                                                 \
  template void H5File::write<T>(const std::string&, std::span<const T>, const H5Shape&);   \
  template void H5File::allocate<T>(const std::string&, const H5Shape&);                    \
  template void H5File::write_rows<T>(const std::string&, std::size_t, std::span<const T>); \
  template std::vector<T> H5File::read<T>(const std::string&) const;
ECHOFUSE_H5_TYPE(float)
ECHOFUSE_H5_TYPE(double)
ECHOFUSE_H5_TYPE(std::int8_t)
ECHOFUSE_H5_TYPE(std::uint8_t)
ECHOFUSE_H5_TYPE(std::uint16_t)
ECHOFUSE_H5_TYPE(std::uint32_t)
ECHOFUSE_H5_TYPE(std::int32_t)
ECHOFUSE_H5_TYPE(std::int64_t)
ECHOFUSE_H5_TYPE(std::uint64_t)
#undef ECHOFUSE_H5_TYPE

}  // namespace echofuse::record
