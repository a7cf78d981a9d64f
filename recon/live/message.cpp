// SPDX-License-Identifier: MIT
#include "recon/live/message.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "drivers/util/printable.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::view {
namespace {

using Json = nlohmann::json;
constexpr std::size_t alignment = 8;

void pad(Bytes& bytes) { bytes.resize((bytes.size() + alignment - 1) / alignment * alignment); }

bool is_index(const Json& value) {
  return value.is_number_integer() && value >= 0 && value <= std::int64_t{1} << 53;
}

Request sum_of(const Json& value) {
  if (!value.is_array() || value.size() != 3 || !is_index(value[0]) || value[0] > max_summed ||
      !value[1].is_number() || !value[2].is_number())
    return BadRequest{
        "sum: expected [number of records (0 to 1000), fit range start (m), fit range end (m)]"};
  return ShowSum{value[0].get<std::int64_t>(), {value[1].get<double>(), value[2].get<double>()}};
}

Request mark_of(const Json& text, bool label) {
  if (!text.is_string()) return BadRequest{"mark and label: expected a string"};
  Mark mark{label, text.get<std::string>()};
  if (mark.text.size() > max_text_bytes || (mark.text.empty() && !label))
    return BadRequest{
        "text too long or empty: expected 1 to 200 bytes for a mark, 0 to 200 for a label"};
  if (printable(mark.text) != mark.text) return BadRequest{"expected one line of printable text"};
  return mark;
}

}  // namespace

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(); }

template <class T>
void MessageWriter::add(const std::string& name, std::span<const T> values,
                        std::vector<std::size_t> shape) {
  arrays_.push_back({name, recon::type_name<T>("uif"), bytes_.size(), std::move(shape)});
  const auto* first = reinterpret_cast<const std::uint8_t*>(values.data());
  bytes_.insert(bytes_.end(), first, first + values.size_bytes());
  pad(bytes_);
}

template void MessageWriter::add(const std::string&, std::span<const std::uint8_t>,
                                 std::vector<std::size_t>);
template void MessageWriter::add(const std::string&, std::span<const std::uint16_t>,
                                 std::vector<std::size_t>);
template void MessageWriter::add(const std::string&, std::span<const std::uint32_t>,
                                 std::vector<std::size_t>);
template void MessageWriter::add(const std::string&, std::span<const float>,
                                 std::vector<std::size_t>);
template void MessageWriter::add(const std::string&, std::span<const double>,
                                 std::vector<std::size_t>);

Message MessageWriter::finish(Json header) const {
  Json arrays = Json::object();
  for (const Array& a : arrays_)
    arrays[a.name] = {{"type", a.type}, {"offset", a.offset}, {"shape", a.shape}};
  header["arrays"] = std::move(arrays);
  const std::string text = header.dump(-1, ' ', false, Json::error_handler_t::replace);
  auto out = std::make_shared<Bytes>();
  out->reserve(text.size() + bytes_.size() + 2 * alignment);
  put(*out, static_cast<std::uint32_t>(text.size()));
  out->insert(out->end(), text.begin(), text.end());
  pad(*out);
  out->insert(out->end(), bytes_.begin(), bytes_.end());
  return out;
}

Request parse_request(std::string_view text) {
  if (text.size() > max_request_bytes) return BadRequest{"request too long (limit 1024 bytes)"};
  // Limits the nesting depth, because deep nesting would take much stack space and time. Valid
  // requests have at most two levels.
  int depth = 0, deepest = 0;
  for (const char c : text) {
    depth += (c == '[' || c == '{') - (c == ']' || c == '}');
    deepest = std::max(deepest, depth);
  }
  const Json request = deepest > 8 ? Json() : Json::parse(text, nullptr, false);
  if (!request.is_object() || request.size() != 1)
    return BadRequest{"expected a JSON object with one key"};
  const std::string& key = request.begin().key();
  const Json& value = *request.begin();
  if (key == "show" && value == "live") return ShowLive{};
  if (key == "show" && is_index(value)) return ShowRecord{value.get<std::int64_t>()};
  if (key == "sheet" && value.is_array() && value.size() == 2 && is_index(value[0]) &&
      is_index(value[1]) && value[0] <= value[1])
    return ShowSheet{value[0].get<std::int64_t>(), value[1].get<std::int64_t>()};
  if (key == "sum") return sum_of(value);
  if (key == "mark" || key == "label") return mark_of(value, key == "label");
  return BadRequest{"unknown request: expected show, sheet, sum, mark or label"};
}

}  // namespace echofuse::view
