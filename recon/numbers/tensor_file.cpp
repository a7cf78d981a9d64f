// SPDX-License-Identifier: MIT
#include "recon/numbers/tensor_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <sstream>
#include <tuple>

#include "drivers/core/crc32c.hpp"
#include "drivers/util/caused_error.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

using nlohmann::json;

constexpr std::size_t max_header = 1 << 20, max_rank = 4;
constexpr const char* no_crc = "00000000";
constexpr double max_size = 1e18;

std::size_t bytes_of(const std::string& type) {
  return type == "F32" || type == "U32" ? 4 : type == "F64" || type == "I64" ? 8 : type == "U8";
}

ByteView as_bytes(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// Returns the number of values, or TensorFile::any if the product of the dimensions overflows.
std::size_t size_of(const TensorShape& shape) {
  std::size_t out = 1;
  for (const std::size_t n : shape)
    if (__builtin_mul_overflow(out, n, &out)) return TensorFile::any;
  return out;
}

std::string to_text(const TensorShape& shape) {
  std::string out;
  for (const std::size_t n : shape)
    out += (out.empty() ? "" : " x ") + (n == TensorFile::any ? "any" : std::to_string(n));
  return out;
}

std::string bounds(double minimum, double maximum) {
  std::ostringstream out;
  out << "expected a number from " << minimum << " to " << maximum;
  return out.str();
}

std::string hex(std::uint32_t value) {
  std::ostringstream out;
  out << std::hex << std::setw(8) << std::setfill('0') << value;
  return out.str();
}

}  // namespace

void TensorFile::refuse(const std::string& object, const std::string& why) const {
  throw Error(ExitCode::failed, path_ + ": " + printable(object) + ": " + printable(why));
}

TensorFile::TensorFile(std::string path, ByteView contents) : path_(std::move(path)) {
  const auto refuse_file = [&](const std::string& why) {
    throw CausedError(Cause::other_format, path_ + ": " + why);
  };
  ByteReader in(contents);
  const auto length = in.get<std::uint64_t>();
  if (contents.size() >= 4 && std::memcmp(contents.data(), "ECHO", 4) == 0)
    refuse_file("the model has an older format; train it again");
  // Runs get a message of their own, because users may swap the arguments.
  constexpr std::string_view sqlite = "SQLite format 3";
  if (contents.size() > sqlite.size() &&
      std::memcmp(contents.data(), sqlite.data(), sqlite.size()) == 0)
    refuse_file("is a run; expected a model file");
  if (!in.ok() || length > max_header || length > in.left())
    refuse_file("not a model file, or truncated; expected a safetensors file");
  const ByteView raw = in.take(length);
  std::string header(raw.begin(), raw.end());
  const ByteView values = contents.subspan(8 + length);
  const auto mark = header.find("\"crc32c\":\"");
  if (mark == std::string::npos || mark + 18 > header.size())
    refuse_file("has no checksum; expected a model written by echofuse-recon train");
  const std::string stated = header.substr(mark + 10, 8);
  header.replace(mark + 10, 8, no_crc);
  const std::uint32_t crc = crc32c(values, crc32c(as_bytes(header), crc32c(contents.first(8))));
  if (stated != hex(crc)) throw Error(ExitCode::failed, path_ + ": damaged: checksum mismatch");
  parse(header, values);
}

// Converts exceptions of the JSON library to Error(failed).
void TensorFile::parse(const std::string& header, ByteView values) try {
  std::vector<std::tuple<std::size_t, std::size_t, Bytes*>> places;
  const json head = json::parse(header);
  for (const auto& [name, entry] : head.items()) {
    if (name == "__metadata__") continue;
    const json &shape = entry.at("shape"), &offsets = entry.at("data_offsets");
    // Rejects numbers other than unsigned integers, because the JSON library would convert these
    // without an error.
    for (const json* list : {&shape, &offsets})
      if (!std::all_of(list->begin(), list->end(),
                       [](const json& n) { return n.is_number_unsigned(); }))
        refuse(name, "expected whole numbers in shape and data_offsets");
    Tensor tensor{entry.at("dtype").get<std::string>(), shape.get<TensorShape>(), {}};
    const auto begin = offsets.at(0).get<std::size_t>(), end = offsets.at(1).get<std::size_t>();
    const std::size_t width = bytes_of(tensor.type), count = size_of(tensor.shape);
    if (width == 0) refuse(name, "type " + tensor.type + "; expected F32, F64, I64, U32 or U8");
    if (tensor.shape.size() > max_rank)
      refuse(name,
             "has " + std::to_string(tensor.shape.size()) + " dimensions; expected at most 4");
    if (begin > end || end > values.size())
      refuse(name, "its data extend beyond the end of the file");
    if (count > values.size() || count * width != end - begin)
      refuse(name, "the data size does not match the shape " + to_text(tensor.shape));
    const auto taken = tensors_.emplace(name, std::move(tensor)).first;
    places.emplace_back(begin, end, &taken->second.values);
  }
  std::sort(places.begin(), places.end());
  std::size_t at = 0;
  for (const auto& [begin, end, own] : places) {
    if (begin != at) refuse("data_offsets", "tensors overlap or leave a gap");
    at = end;
  }
  if (at != values.size())
    refuse("data_offsets", "the file contains bytes that belong to no tensor");
  // Copies the values only after checking that the tensors do not overlap, so that the copies need
  // at most as much memory as the file.
  for (const auto& [begin, end, own] : places)
    own->assign(values.begin() + static_cast<std::ptrdiff_t>(begin),
                values.begin() + static_cast<std::ptrdiff_t>(end));
  const json stored = json::parse(head.at("__metadata__").at("facts").get<std::string>());
  for (const auto& [name, fact] : stored.items()) {
    if (fact.is_string())
      facts[name] = fact.get<std::string>();
    else if (fact.is_number_float())
      facts[name] = fact.get<double>();
    else if (fact.is_number_integer())
      facts[name] = fact.get<std::int64_t>();
    else
      refuse(name, "expected a number or a string");
  }
} catch (const json::exception&) {
  throw CausedError(Cause::other_format, path_ + ": not a model file: invalid JSON header");
}

Bytes TensorFile::to_bytes() const {
  json stored = json::object(), head = json::object();
  for (const auto& [name, fact] : facts)
    std::visit([&, key = name](const auto& value) { stored[key] = value; }, fact);
  head["__metadata__"] = {{"crc32c", no_crc},
                          {"facts", stored.dump()},
                          {"kernel", blas_kernels()},
                          {"commit", commit()}};
  std::size_t at = 0;
  std::vector<const Tensor*> order;
  for (const std::size_t width : {8U, 4U, 1U})
    for (const auto& [name, tensor] : tensors_) {
      if (bytes_of(tensor.type) != width) continue;
      head[name] = {{"dtype", tensor.type},
                    {"shape", tensor.shape},
                    {"data_offsets", {at, at + tensor.values.size()}}};
      at += tensor.values.size();
      order.push_back(&tensor);
    }
  std::string header = head.dump();
  header.resize((header.size() + 7) / 8 * 8, ' ');
  Bytes out;
  out.reserve(8 + header.size() + at);
  put(out, std::uint64_t{header.size()});
  out.insert(out.end(), header.begin(), header.end());
  for (const Tensor* tensor : order)
    out.insert(out.end(), tensor->values.begin(), tensor->values.end());
  const std::string crc = hex(crc32c(out));
  std::copy(crc.begin(), crc.end(),
            out.begin() + 8 + std::ssize("\"crc32c\":\"") - 1 +
                static_cast<std::ptrdiff_t>(header.find("\"crc32c\":\"")));
  return out;
}

template <class T>
void TensorFile::write(const std::string& name, std::span<const T> values,
                       const TensorShape& shape) {
  Tensor& to = tensors_[name] = {type_name<T>("UIF"), shape, Bytes(values.size_bytes())};
  if (!values.empty()) std::memcpy(to.values.data(), values.data(), values.size_bytes());
}

const TensorFile::Tensor& TensorFile::found(const std::string& name) const {
  const auto at = tensors_.find(name);
  if (at == tensors_.end()) refuse(name, "is missing");
  return at->second;
}

TensorShape TensorFile::shape(const std::string& name) const { return found(name).shape; }

template <class T>
std::vector<T> TensorFile::read(const std::string& name, const TensorShape& shape) const {
  const Tensor& tensor = found(name);
  if (tensor.type != type_name<T>("UIF"))
    refuse(name, "has type " + tensor.type + "; expected " + type_name<T>("UIF"));
  const bool fits = std::equal(
      shape.begin(), shape.end(), tensor.shape.begin(), tensor.shape.end(),
      [](std::size_t required, std::size_t is) { return required == any || required == is; });
  if (!fits) refuse(name, "has shape " + to_text(tensor.shape) + "; expected " + to_text(shape));
  std::vector<T> out = to_values<T>(tensor.values);
  if constexpr (std::is_floating_point_v<T>)
    if (!std::all_of(out.begin(), out.end(),
                     [](T v) { return std::abs(v) <= static_cast<T>(max_size); }))
      refuse(name, "expected finite numbers up to 1e18");
  return out;
}

template <class T>
void Archive::values(const std::string& name, std::vector<T>& values, std::size_t count) {
  if (reading())
    values = file_->read<T>(group_ + name, {count});
  else
    file_->write<T>(group_ + name, values, {values.size()});
}

template void Archive::values(const std::string&, std::vector<float>&, std::size_t);
template void Archive::values(const std::string&, std::vector<double>&, std::size_t);
template void Archive::values(const std::string&, std::vector<std::int64_t>&, std::size_t);
template void Archive::values(const std::string&, std::vector<std::uint32_t>&, std::size_t);
template void Archive::values(const std::string&, std::vector<std::uint8_t>&, std::size_t);

void Archive::table(const std::string& name, Matrix& table, std::size_t rows, std::size_t cols) {
  if (!reading()) return file_->write<float>(group_ + name, table.values, {table.rows, table.cols});
  const auto values = file_->read<float>(group_ + name, {rows, cols});
  const TensorShape shape = file_->shape(group_ + name);
  table = Matrix(shape[0], shape[1]);
  std::copy(values.begin(), values.end(), table.values.begin());
}

template <class T>
T Archive::fact(const std::string& name, const char* expected) const {
  const auto at = file_->facts.find(group_ + name);
  if (at == file_->facts.end()) file_->refuse(group_ + name, "is missing");
  const T* value = std::get_if<T>(&at->second);
  if (!value) file_->refuse(group_ + name, std::string("expected ") + expected);
  return *value;
}

void Archive::number(const std::string& name, double& value, double minimum, double maximum) {
  if (!reading()) return void(file_->facts[group_ + name] = value);
  const auto at = file_->facts.find(group_ + name);
  const bool whole = at != file_->facts.end() && std::holds_alternative<std::int64_t>(at->second);
  value = whole ? static_cast<double>(fact<std::int64_t>(name, "a number"))
                : fact<double>(name, "a number");
  require(value >= minimum && value <= maximum, name, bounds(minimum, maximum));
}

void Archive::number(const std::string& name, float& value, double minimum, double maximum) {
  auto wide = double{value};
  number(name, wide, minimum, maximum);
  value = static_cast<float>(wide);
}

void Archive::integer(const std::string& name, std::int64_t& value, std::int64_t minimum,
                      std::int64_t maximum) {
  if (!reading()) return void(file_->facts[group_ + name] = value);
  value = fact<std::int64_t>(name, "a whole number");
  require(value >= minimum && value <= maximum, name,
          bounds(static_cast<double>(minimum), static_cast<double>(maximum)));
}

void Archive::text(const std::string& name, std::string& value,
                   const std::vector<std::string>& allowed) {
  if (!reading()) return void(file_->facts[group_ + name] = value);
  value = fact<std::string>(name, "a string");
  std::string all;
  for (const std::string& one : allowed) all += (all.empty() ? "expected one of " : ", ") + one;
  require(allowed.empty() || std::find(allowed.begin(), allowed.end(), value) != allowed.end(),
          name, all);
}

bool Archive::part(const std::string& name, bool there) {
  auto number = std::int64_t{there};
  integer(name, number, 0, 1);
  return number != 0;
}

void Archive::require_shape(const std::string& name, const TensorShape& shape) const {
  if (reading() && file_->shape(group_ + name) != shape)
    file_->refuse(group_ + name, "expected shape " + to_text(shape));
}

void Archive::require(bool sound, const std::string& name, const std::string& expected) const {
  if (reading() && !sound) file_->refuse(group_ + name, expected);
}

}  // namespace echofuse::recon
