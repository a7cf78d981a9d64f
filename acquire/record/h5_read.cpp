// SPDX-License-Identifier: MIT
#include <cmath>

#include "acquire/record/h5_handle.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
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
  return shape_of(space.get());
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
  const Handle set(dataset(name), H5Dclose);
  const Handle type(H5Dget_type(set.get()), H5Tclose);
  const std::size_t count = product(shape(name));
  std::vector<std::string> texts;
  if (H5Tget_class(type.get()) != H5T_STRING) refuse(name, "holds no texts");
  if (count == 0) return texts;
  if (H5Tis_variable_str(type.get()) > 0) {
    std::vector<char*> raw(count, nullptr);
    const Handle memory(text_type(H5T_VARIABLE), H5Tclose);
    if (H5Dread(set.get(), memory.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) < 0)
      fail(name, "cannot read as texts", false);
    for (char* t : raw) {
      texts.emplace_back(t ? t : "");
      H5free_memory(t);
    }
    return texts;
  }
  const std::size_t length = H5Tget_size(type.get());
  std::string raw(count * length, '\0');
  if (H5Dread(set.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) < 0)
    fail(name, "cannot read as texts", false);
  for (std::size_t i = 0; i < count; ++i)
    texts.push_back(checked(name, raw.substr(i * length, length)));
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

// Of fixed length: without the zeros behind it. No text that we write moves a terminal's cursor.
std::string H5File::checked(const std::string& name, std::string text) const {
  text.resize(std::min(text.find('\0'), text.size()));
  if (text != printable(text)) refuse(name, "holds control characters; expected a plain text");
  return text;
}

template <>
std::string H5File::get(const std::string& object, const std::string& attribute) const {
  const std::string place = object + "@" + attribute;
  const Handle found(open_attribute(object, attribute, H5T_STRING), H5Aclose);
  const Handle type(H5Aget_type(found.get()), H5Tclose);
  if (H5Tis_variable_str(type.get()) > 0) {
    const Handle memory(text_type(H5T_VARIABLE), H5Tclose);
    char* raw = nullptr;
    if (H5Aread(found.get(), memory.get(), &raw) < 0) fail(place, "cannot read as a text", false);
    std::string text = raw ? raw : "";
    H5free_memory(raw);
    return text;
  }
  std::string text(H5Tget_size(type.get()), '\0');
  if (H5Aread(found.get(), type.get(), text.data()) < 0)
    fail(place, "cannot read as a text", false);
  return checked(place, std::move(text));
}

template <>
double H5File::get(const std::string& object, const std::string& attribute) const {
  const Handle found(open_attribute(object, attribute, H5T_FLOAT), H5Aclose);
  double value = 0;
  if (H5Aread(found.get(), H5T_NATIVE_DOUBLE, &value) < 0)
    fail(object + "@" + attribute, "cannot read as a number", false);
  return value;
}

template <>
std::int64_t H5File::get(const std::string& object, const std::string& attribute) const {
  const Handle found(open_attribute(object, attribute, H5T_INTEGER), H5Aclose);
  std::int64_t value = 0;
  if (H5Aread(found.get(), H5T_NATIVE_INT64, &value) < 0)
    fail(object + "@" + attribute, "cannot read as a number", false);
  return value;
}

// A single value of this class. A whole array would be read over what is there for one.
std::int64_t H5File::open_attribute(const std::string& object, const std::string& attribute,
                                    int wanted) const {
  const std::string place = object + "@" + attribute;
  const hid_t found =
      H5Aopen_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT);
  if (found < 0) fail(place, "no such attribute", false);
  const Handle type(H5Aget_type(found), H5Tclose), space(H5Aget_space(found), H5Sclose);
  const bool fits = H5Tget_class(type.get()) == wanted &&
                    H5Sget_simple_extent_type(space.get()) == H5S_SCALAR &&
                    (wanted == H5T_STRING || H5Tget_size(type.get()) <= sizeof(double));
  if (fits) return found;
  H5Aclose(found);
  refuse(place, std::string("expected ") + (wanted == H5T_STRING  ? "one text"
                                            : wanted == H5T_FLOAT ? "one floating point number"
                                                                  : "one whole number"));
}

#define ECHOFUSE_H5_TYPE(T) template std::vector<T> H5File::read<T>(const std::string&) const;
ECHOFUSE_H5_TYPES(ECHOFUSE_H5_TYPE)
#undef ECHOFUSE_H5_TYPE

}  // namespace echofuse::record
