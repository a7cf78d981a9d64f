// SPDX-License-Identifier: MIT
// What the files of H5File share: handles of HDF5 and its types.
#pragma once
#include <hdf5.h>

#include <functional>
#include <numeric>
#include <type_traits>

#include "acquire/record/h5.hpp"

// The types of the arrays of a file: X(T) for each.
#define ECHOFUSE_H5_TYPES(X) \
  X(float)                   \
  X(double)                  \
  X(std::int8_t)             \
  X(std::uint8_t) X(std::uint16_t) X(std::uint32_t) X(std::int32_t) X(std::int64_t) X(std::uint64_t)

namespace echofuse::record {

static_assert(std::is_same_v<hid_t, std::int64_t>);

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

// Before any other call. HDF5 prints every failed call otherwise; ours are reported once, as Error.
// At the end of the process it would try again to write what a full disk did not take, and crash.
inline void quiet() {
  H5dont_atexit();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

inline std::size_t product(const H5Shape& shape) {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
}

inline H5Shape shape_of(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> sizes(rank > 0 ? static_cast<std::size_t>(rank) : 0);
  if (rank > 0) H5Sget_simple_extent_dims(space, sizes.data(), nullptr);
  return {sizes.begin(), sizes.end()};
}

}  // namespace echofuse::record
