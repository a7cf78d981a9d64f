// SPDX-License-Identifier: MIT
// What stands in an HDF5 file, as HDF5's own C++ library reads it.
#pragma once
#include <H5Cpp.h>

#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

namespace testing {

class H5Reader {
 public:
  explicit H5Reader(const std::string& path) : file_(path, H5F_ACC_RDONLY) {}

  bool has(const std::string& name) const { return file_.nameExists(name); }
  std::vector<std::size_t> shape(const std::string& name) const {
    const H5::DataSpace space = file_.openDataSet(name).getSpace();
    std::vector<hsize_t> sizes(static_cast<std::size_t>(space.getSimpleExtentNdims()));
    space.getSimpleExtentDims(sizes.data());
    return {sizes.begin(), sizes.end()};
  }
  // Converted to T as HDF5 does between numbers.
  template <class T>
  std::vector<T> read(const std::string& name) const {
    const H5::DataSet set = file_.openDataSet(name);
    std::vector<T> values(count(set));
    set.read(values.data(), type<T>());
    return values;
  }
  // Of fixed length, without the zeros behind them.
  std::vector<std::string> read_texts(const std::string& name) const {
    const H5::DataSet set = file_.openDataSet(name);
    const H5::StrType text = set.getStrType();
    std::string raw(count(set) * text.getSize(), '\0');
    if (!raw.empty()) set.read(raw.data(), text);
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < count(set); ++i)
      texts.emplace_back(raw.substr(i * text.getSize(), text.getSize()).c_str());
    return texts;
  }
  std::string read_text(const std::string& name) const { return read_texts(name).at(0); }
  std::string text_of(const std::string& object, const std::string& attribute) const {
    const H5::Attribute found = open(object, attribute);
    H5std_string text;
    found.read(found.getStrType(), text);
    return text;
  }
  double number_of(const std::string& object, const std::string& attribute) const {
    double number = 0;
    open(object, attribute).read(H5::PredType::NATIVE_DOUBLE, &number);
    return number;
  }

 private:
  H5::Attribute open(const std::string& object, const std::string& attribute) const {
    return file_.childObjType(object) == H5O_TYPE_GROUP
               ? file_.openGroup(object).openAttribute(attribute)
               : file_.openDataSet(object).openAttribute(attribute);
  }
  static std::size_t count(const H5::DataSet& set) {
    return static_cast<std::size_t>(set.getSpace().getSimpleExtentNpoints());
  }
  template <class T>
  static const H5::PredType& type() {
    if constexpr (std::is_same_v<T, float>) return H5::PredType::NATIVE_FLOAT;
    if constexpr (std::is_same_v<T, double>) return H5::PredType::NATIVE_DOUBLE;
    if constexpr (std::is_same_v<T, std::uint8_t>) return H5::PredType::NATIVE_UINT8;
    if constexpr (std::is_same_v<T, std::uint32_t>) return H5::PredType::NATIVE_UINT32;
    if constexpr (std::is_same_v<T, std::int64_t>) return H5::PredType::NATIVE_INT64;
    if constexpr (std::is_same_v<T, std::uint64_t>) return H5::PredType::NATIVE_UINT64;
  }
  H5::H5File file_;
};

}  // namespace testing
