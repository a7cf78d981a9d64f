// SPDX-License-Identifier: MIT
// Model files that no training made: HDF5 edited by hand, then sealed again, so that the checksum
// is right and only what stands behind it is wrong. Also for the fuzz target, so without Catch.
#pragma once
#include <hdf5.h>

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/record/h5.hpp"

namespace echofuse::crafted {

using Edit = std::function<void(hid_t file)>;

// False if HDF5 cannot open it any more.
inline bool edit(const std::string& path, const Edit& change) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  if (file < 0) return false;
  change(file);
  H5Fclose(file);
  record::H5File::seal(path);
  return true;
}

// Names of its groups and arrays, without the root; every "object@attribute".
struct Names {
  std::vector<std::string> groups, arrays;
  std::vector<std::pair<std::string, std::string>> attributes;
};

inline Names names_of(hid_t file) {
  Names out;
  const auto add = [](hid_t object, const char* name, const H5O_info_t* info, void* to) -> herr_t {
    auto& names = *static_cast<Names*>(to);
    if (std::string(name) != ".")
      (info->type == H5O_TYPE_GROUP ? names.groups : names.arrays).emplace_back(name);
    const hid_t one = H5Oopen(object, name, H5P_DEFAULT);
    for (hsize_t i = 0; i < info->num_attrs; ++i) {
      const hid_t attribute =
          H5Aopen_by_idx(one, ".", H5_INDEX_NAME, H5_ITER_NATIVE, i, H5P_DEFAULT, H5P_DEFAULT);
      char title[64] = {};
      H5Aget_name(attribute, sizeof title, title);
      names.attributes.emplace_back(name, title);
      H5Aclose(attribute);
    }
    H5Oclose(one);
    return 0;
  };
  H5Ovisit(file, H5_INDEX_NAME, H5_ITER_NATIVE, add, &out);
  return out;
}

// In the place of an array another one of any type and extent, filled with a byte if wanted;
// without that its values are promised and never written.
inline void replace_array(hid_t file, const std::string& name, hid_t type,
                          const std::vector<hsize_t>& extent, int fill = -1,
                          hid_t how = H5P_DEFAULT) {
  H5Ldelete(file, name.c_str(), H5P_DEFAULT);
  const hid_t space =
      extent.empty() ? H5Screate(H5S_SCALAR)
                     : H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr);
  const hid_t made = H5Dcreate2(file, name.c_str(), type, space, H5P_DEFAULT, how, H5P_DEFAULT);
  if (made >= 0 && fill >= 0) {
    std::size_t bytes = H5Tget_size(type);
    for (const hsize_t n : extent) bytes *= n;
    const std::vector<std::uint8_t> values(bytes, static_cast<std::uint8_t>(fill));
    H5Dwrite(made, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  }
  if (made >= 0) H5Dclose(made);
  H5Sclose(space);
}

inline std::vector<hsize_t> extent_of(hid_t file, const std::string& name) {
  const hid_t set = H5Dopen2(file, name.c_str(), H5P_DEFAULT), space = H5Dget_space(set);
  std::vector<hsize_t> out(static_cast<std::size_t>(H5Sget_simple_extent_ndims(space)));
  if (!out.empty()) H5Sget_simple_extent_dims(space, out.data(), nullptr);
  H5Sclose(space);
  H5Dclose(set);
  return out;
}

// `values`: as many as the extent says; none: one value.
inline void replace_attribute(hid_t file, const std::string& object, const std::string& attribute,
                              hid_t type, const void* values, hsize_t count = 0) {
  H5Adelete_by_name(file, object.c_str(), attribute.c_str(), H5P_DEFAULT);
  const hid_t space = count == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr);
  const hid_t made = H5Acreate_by_name(file, object.c_str(), attribute.c_str(), type, space,
                                       H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  if (made >= 0) {
    H5Awrite(made, type, values);
    H5Aclose(made);
  }
  H5Sclose(space);
}

}  // namespace echofuse::crafted
