// SPDX-License-Identifier: MIT
// Input: u8 kind. For kind 0, a model file follows. Any other kind selects one of the models
// trained at the start, and edits follow until the input ends. Each edit has u8 kind and its
// arguments. The checksum of the file is corrected, so that the code behind the check is tested.
#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "../fixtures/dataset.hpp"
#include "../fixtures/run.hpp"
#include "../recon/crafted.hpp"
#include "fuzz.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/predict/predict.hpp"
#include "recon/train/train.hpp"

using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

constexpr std::size_t pixels = 64 * 64;

std::string scratch_file() {
  return std::filesystem::temp_directory_path() / ("echofuse-fuzz-" + std::to_string(::getpid()));
}

Dataset plates(std::int64_t count) {
  const std::string path = scratch_file();
  Dataset all = load({a_run(count).write(path)});
  std::filesystem::remove(path);
  return all;
}

crafted::Model make_base(const Dataset& data, const std::string& kind, bool whole) {
  TrainOptions how;
  how.model = kind;
  how.fit.epochs = 2, how.fit.quiet = true;
  how.split.validation_share = 0.25;
  how.uncertainty = whole;
  TrainedModel model = train(data, how);
  if (kind.starts_with("mlp")) {
    how.model = "pca-mlp-6-5", how.inputs = "spd";
    model.estimators.push_back(std::move(train(data, how).first()));
  }
  const std::string path = scratch_file();
  save_model(model, path);
  const Bytes contents = read_file(path);
  std::filesystem::remove(path);
  return crafted::Model(contents);
}

const std::vector<crafted::Model>& bases() {
  static const std::vector<crafted::Model> all = [] {
    set_threads(1);
    const Dataset records = plates(220);
    std::vector<crafted::Model> out;
    out.push_back(make_base(records, "factorised-3", true));
    out.push_back(make_base(records, "mlp-6-5", true));
    out.push_back(make_base(records, "pca-mlp-8", false));
    out.push_back(make_base(records, "nearest-3", false));
    out.push_back(make_base(records, "mean-shape", false));
    return out;
  }();
  return all;
}

template <class T>
const T& one_of(const std::vector<T>& all, std::size_t which) {
  return all[which % all.size()];
}

// Applies one edit to a model file.
class Editor {
 public:
  Editor(crafted::Model& model, ByteReader& in) : model_(model), in_(in) {}

  void edit() {
    const std::uint8_t kind = byte();
    if (kind % 2 == 0) return fact(kind / 2 % 2 == 0);
    const std::vector<std::string> names = model_.tensors();
    if (names.empty()) return;
    const std::string name = one_of(names, byte());
    if (!model_.head[name].contains("data_offsets")) return;
    if (kind >= 0xf0) return again(name);
    if (kind / 2 % 4 == 0) return array(name);
    if (kind / 2 % 4 == 1) return value(name);
    if (kind / 2 % 4 == 2) return entry(name);
    const nlohmann::json moved = model_.head[name];
    model_.head.erase(name);
    if (byte() % 2 == 0) model_.head[one_of(names, byte())] = moved;
  }

 private:
  std::uint8_t byte() { return in_.get<std::uint8_t>(); }

  // Returns either a special value, such as NaN, or a random number.
  double number() {
    const std::vector<double> some = {0,    -1,    1,   1e-30,    1e18, -1e18,
                                      3e38, 1e300, NAN, INFINITY, 7,    100};
    const std::uint8_t which = byte();
    return which < 128 ? one_of(some, which) : in_.get<double>();
  }

  nlohmann::json any_json() {
    const std::uint8_t kind = byte();
    const std::vector<std::string> texts = {"",        "x",   "spd",    "fused",      "mlp",
                                            "ridge",   "raw", "record", "nearest",    "factorised",
                                            "\x1b[2J", "ps",  "power",  "lags, 99 up"};
    if (kind % 4 == 0) return one_of(texts, byte());
    if (kind % 4 == 1) return number();
    if (kind % 4 == 2) return in_.get<std::int64_t>();
    const std::vector<nlohmann::json> some = {
        nullptr, true, nlohmann::json::array({1, 2}), nlohmann::json::object(), 0, 1, 2, 3, 4,
        54,      64};
    return one_of(some, byte());
  }

  void fact(bool gone) {
    const std::vector<std::string> names = model_.names_of_facts();
    if (names.empty()) return;
    const std::string name = one_of(names, in_.get<std::uint16_t>());
    if (gone && byte() % 4 == 0)
      model_.facts.erase(name);
    else
      model_.facts[name] = any_json();
  }

  void array(const std::string& name) {
    static const std::vector<std::string> types = {"F32", "F64", "U8", "U32", "I64", "F16"};
    static const std::vector<std::size_t> sides = {
        0, 1, 2, 3, 4, 5, 6, 10, 24, 30, 54, 64, 4095, 4096, 4097, std::size_t{1} << 40};
    const std::string type = one_of(types, byte());
    std::vector<std::size_t> shape(byte() % 6);
    std::size_t bytes = type == "U8" ? 1 : type == "F64" || type == "I64" ? 8 : 4;
    for (std::size_t& n : shape) {
      n = one_of(sides, byte());
      bytes = bytes < (1u << 20) ? bytes * n : bytes;
    }
    if (!sound(name)) return;
    model_.replace(name, type, shape, bytes < (1u << 20) ? bytes : 0, byte());
  }

  // Changes either the first value or all values of a tensor.
  void value(const std::string& name) {
    const bool all = byte() % 2 == 0;
    const double expected = number();
    if (!sound(name)) return;
    // `type` may have any value, because entry() may have changed it.
    const nlohmann::json& type = model_.head[name]["dtype"];
    const bool whole = std::isfinite(expected) && std::abs(expected) < 9e18;
    Bytes one;
    if (type == "F32")
      put(one, static_cast<float>(expected));
    else if (type == "F64")
      put(one, expected);
    else
      put(one, whole ? static_cast<std::int64_t>(expected) : std::int64_t{-1});
    const std::size_t begin = model_.begin_of(name), last = model_.end_of(name);
    const std::size_t end = all ? last : std::min(last, begin + 8);
    for (std::size_t at = begin; at + one.size() <= end; at += one.size())
      std::copy(one.begin(), one.end(), model_.values.begin() + static_cast<std::ptrdiff_t>(at));
  }

  // Changes a header field of a tensor.
  void entry(const std::string& name) {
    const std::vector<const char*> keys = {"dtype", "shape", "data_offsets"};
    const std::string key = one_of(keys, byte());
    nlohmann::json list = nlohmann::json::array();
    for (int n = byte() % 4; n > 0; --n) list.push_back(any_json());
    model_.head[name][key] = byte() % 4 == 0 ? any_json() : list;
  }

  // Adds up to 8192 tensors that share the bytes of the tensor `name`.
  void again(const std::string& name) {
    const nlohmann::json same = model_.head[name];
    for (int n = 1 << byte() % 14; n > 0; --n) model_.head["z" + std::to_string(n)] = same;
  }

  // Returns true if the header is valid enough to locate the tensor's values.
  bool sound(const std::string& name) const {
    for (const auto& [other, e] : model_.head.items()) {
      if (!e.contains("data_offsets") || e["data_offsets"].size() != 2) return false;
      for (const auto& offset : e["data_offsets"])
        if (!offset.is_number_unsigned() || offset.get<std::size_t>() > model_.values.size())
          return false;
    }
    return model_.begin_of(name) <= model_.end_of(name);
  }

  crafted::Model& model_;
  ByteReader& in_;
};

// Checks that a loaded model predicts only finite values.
void check_answers(const TrainedModel& model) {
  static const Dataset few = plates(3);
  Dataset data = few;
  // The record without a radar echo makes the model use its fallback.
  std::ranges::fill(profiles(data).row(2), 0.f);
  model.match(data);
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (model.fault_of(data, row).empty()) rows.push_back(row);
  const Prediction found =
      predict(model, data, rows,
              model.first().uncertainty ? PredictionDetail::pixels : PredictionDetail::uncertainty);
  require(found.maps.values.size() == rows.size() * pixels, "every record has a map");
  for (const float v : found.maps.values) require(std::isfinite(v), "map values are finite");
  for (const float v : found.deviation.values) require(v >= 0, "a deviation is not negative");
  for (const PredictionUncertainty& uncertainty : found.uncertainties)
    require(fuzz::is_printable(uncertainty.out_of_distribution.text()), "reasons can be printed");
  static const Dataset many = plates(StaticEchoes::min_records);
  Dataset run = many;
  model.match(run);
  const DomainShift shift = domain_shift_of(model, run);
  require(shift.interval_factor >= 1, "intervals never shrink");
  require(fuzz::is_printable(shift.text()), "the comparison of a run can be printed");
}

Bytes file_of(ByteView input, bool& whole) {
  ByteReader in(input);
  const auto which = in.get<std::uint8_t>();
  if (which == 0) {
    const ByteView file = in.take(in.left());
    std::uint64_t length = 0;
    if (file.size() >= 8) std::memcpy(&length, file.data(), sizeof length);
    if (file.size() < 8 || length > file.size() - 8) return {file.begin(), file.end()};
    const ByteView header = file.subspan(8, length);
    return crafted::sealed({header.begin(), header.end()}, file.subspan(8 + length));
  }
  crafted::Model model = one_of(bases(), which);
  whole = in.left() == 0;
  Editor editor(model, in);
  for (int i = 0; i < 8 && in.left() > 0; ++i) editor.edit();
  return model.sealed();
}

}  // namespace

void fuzz::run(ByteView input) {
  bool whole = false, accepted = false;
  const Bytes file = file_of(input, whole);
  refused_or_done({ExitCode::failed}, [&] {
    check_answers(load_model("crafted", file));
    accepted = true;
  });
  require(accepted || !whole, "an unchanged model is accepted");
}

// Trains the models before the first input is processed. With sanitizers, training takes longer
// than the time limit for a single input.
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  bases();
  return 0;
}
