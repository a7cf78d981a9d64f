// SPDX-License-Identifier: MIT
// Tests the loading of untrusted model files, which may be truncated, corrupted or malicious.

#include <sys/resource.h>

#include "crafted.hpp"
#include "recon/data/files.hpp"
#include "world.hpp"

namespace {

const std::vector<std::string> kinds = {"factorised-4", "mean-shape",  "ridge",
                                        "mlp-12-10",    "pca-mlp-6-5", "mlp-mask-8",
                                        "nearest-3",    "empty",       "mean"};

// Returns a folder that contains a model file of each kind. Only the factorised-4 model has an
// uncertainty. Only the MLP has a second estimator, which uses only the SPD.
const Folder& models() {
  static const Folder dir;
  static const bool made = [] {
    a_run(500).write(dir / "run");
    const Dataset data = load({dir / "run"});
    for (const std::string& kind : kinds) {
      TrainOptions o = quiet_options(kind, 2);
      o.uncertainty = kind == "factorised-4";
      TrainedModel model = train(data, o);
      if (kind == "mlp-12-10") {
        o.model = "pca-mlp-6-5", o.inputs = "spd";
        model.estimators.push_back(std::move(train(data, o).first()));
      }
      save_model(model, dir / kind);
    }
    a_run(4, 5).write(dir / "few");
    return true;
  }();
  REQUIRE(made);
  return dir;
}

// Loads a model file and returns the error message, which must be a single line. If the file can be
// loaded, the model must predict maps, and an empty string is returned.
std::string fault_of(ByteView file) {
  static const Dataset few = load({models() / "few"});
  try {
    const TrainedModel model = load_model("crafted", file);
    Dataset data = few;
    model.match(data);
    const Prediction found = predict(
        model, data, all_rows(data.size()),
        model.first().uncertainty ? PredictionDetail::pixels : PredictionDetail::uncertainty);
    REQUIRE(found.maps.rows == data.size());
    return {};
  } catch (const Error& error) {
    const std::string text = error.what();
    CHECK(error.code() == ExitCode::failed);
    CHECK(text.find('\n') == std::string::npos);
    return text;
  }
}

Bytes whole_file(const std::string& kind) { return read_file(models() / kind); }

using Spoil = std::function<void(crafted::Model&)>;

struct Hostile {
  const char *what, *saying;
  Spoil change;
  const char* from = "ridge";
};

// Adds a tensor that consists of the bytes [from, to). Both positions are relative to the old end
// of the values. Also appends `more` bytes to the values.
Spoil beside(const std::string& type, std::size_t from, std::size_t to, std::size_t more) {
  return [=](crafted::Model& m) {
    const std::size_t end = m.values.size();
    m.values.resize(end + more);
    m.add("zz", type, {to - from}, end + from, end + to);
  };
}

Spoil shape_of(const char* name, const std::vector<double>& shape) {
  return [=](crafted::Model& m) {
    m.head[name]["shape"] = nlohmann::json::array();
    for (const double side : shape)
      if (side == std::floor(side) && side >= 0 && side < 1e15)
        m.head[name]["shape"].push_back(static_cast<std::uint64_t>(side));
      else
        m.head[name]["shape"].push_back(side);
  };
}

template <class T>
Spoil first_value(const char* name, T value) {
  return [=](crafted::Model& m) { m.set_first(name, value); };
}

template <class T>
Spoil fact(const char* name, const T& value) {
  return [=](crafted::Model& m) { m.facts[name] = value; };
}

const char *const map_name = "0/scene/background_m", *const map_fault = "0/scene/background_m: ";

const std::vector<Hostile> hostile_files = {
    {"an offset beyond the end", "crafted: zz: its data extend beyond the end of the file",
     beside("U8", 0, 8, 0)},
    {"reversed offsets", "crafted: zz: its data extend beyond the end of the file",
     [](auto& m) { m.add("zz", "U8", {1}, 9, 8); }},
    {"a fractional offset", "zz: expected whole numbers",
     [](auto& m) { m.add("zz", "U8", {1}, 0, 1), m.head["zz"]["data_offsets"][1] = 1e300; }},
    {"an overlap", "data_offsets: tensors overlap or leave a gap",
     [](auto& m) { m.add("zz", "U8", {4}, 0, 4); }},
    {"a gap", "data_offsets: tensors overlap or leave a gap", beside("U8", 4, 8, 8)},
    {"unassigned bytes", "data_offsets: the file contains bytes that belong to no tensor",
     beside("U8", 0, 4, 8)},
    {"a shape that is too small", "the data size does not match the shape 4095",
     shape_of(map_name, {4095})},
    {"a shape beyond any memory", "the data size does not match the shape",
     shape_of(map_name, {9e14, 9e14, 9e14})},
    // The tensor size, 4 * (2^62 + 2) bytes, equals 8 modulo 2^64.
    {"a shape beyond 64 bits", "the data size does not match the shape",
     [](auto& m) {
       beside("F32", 0, 8, 8)(m);
       m.head["zz"]["shape"][0] = (std::uint64_t{1} << 62) + 2;
     }},
    {"a negative dimension", "0/scene/background_m: expected whole numbers",
     shape_of(map_name, {-4096})},
    {"five dimensions", "0/scene/background_m: has 5 dimensions; expected at most 4",
     shape_of(map_name, {1, 1, 1, 1, 4096})},
    {"another shape", "0/scene/background_m: has shape 64 x 64; expected 4096",
     shape_of(map_name, {64, 64})},
    {"an unknown type", "0/scene/background_m: type F16; expected F32",
     [](auto& m) { m.head[map_name]["dtype"] = "F16"; }},
    {"another type", "0/scene/background_m: has type U32; expected F32",
     [](auto& m) { m.head[map_name]["dtype"] = "U32"; }},
    {"NaN", map_fault, first_value(map_name, std::nanf(""))},
    {"an infinite number", map_fault, first_value(map_name, INFINITY)},
    {"a NaN weight", "0/model/weights: expected finite numbers",
     first_value("0/model/weights", std::nanf(""))},
    {"a huge weight", "0/model/weights: expected finite numbers up to 1e18",
     first_value("0/model/weights", 2e18f)},
    {"a deviation of 0", "0/model/deviation: expected positive values only",
     first_value("0/model/deviation", 0.f), "factorised-4"},
    {"a missing tensor", "0/model/weights: is missing",
     [](auto& m) { m.head["zz"] = m.head["0/model/weights"], m.head.erase("0/model/weights"); }},
    {"a missing fact", "0/train_s: is missing", [](auto& m) { m.facts.erase("0/train_s"); }},
    {"a text for a number", "0/train_s: expected a number", fact("0/train_s", "long")},
    {"a number for a text", "0/scaling: expected a string", fact("0/scaling", 3)},
    {"a fraction for a count", "estimators: expected a whole number", fact("estimators", 1.5)},
    {"a list for a fact", "0/train_s: expected a number or a string",
     fact("0/train_s", std::vector<int>{1, 2})},
    {"an unknown kind", "0/model: expected one of", fact("0/model", "oracle")},
    {"no estimator", "estimators: expected a number from 1 to 3", fact("estimators", 0)},
    {"four estimators", "estimators: expected a number from 1 to 3", fact("estimators", 4)},
    {"a wrong number of estimators", "1/", fact("estimators", 2)},
    {"an estimator with other axes", "1/axes: expected the same axes as in the first estimator",
     fact("1/axes/spd/step", 401.0), "mlp-12-10"},
    {"two fused estimators", "1/", fact("1/inputs", "fused"), "mlp-12-10"},
    {"fewer bins than weights", "0/features/centre: has shape 54; expected 53",
     fact("0/axes/spd/count", 29)},
    {"layers of different sizes", "0/model/layer1/weights: expected shape 12 x 10",
     shape_of("0/model/layer1/weights", {10, 12}), "mlp-12-10"},
    {"a layer without outputs", "0/model/widths: expected first and last width 54 and 4096",
     [](auto& m) {
       const std::int64_t none = 0;
       std::memcpy(m.values.data() + m.begin_of("0/model/widths") + sizeof none, &none,
                   sizeof none);
     },
     "mlp-12-10"},
    {"another number of layers", "0/model/",
     [](auto& m) { m.replace("0/model/widths", "I64", {2}, 16, 1); }, "mlp-12-10"},
    {"a cell frame of another size", "0/model/masks/mean: has shape",
     fact("0/model/frame/columns", 5), "factorised-4"},
    {"a cell frame of too many columns", "0/model/frame/columns: expected a number from 2 to 96",
     fact("0/model/frame/columns", 97), "factorised-4"},
    {"a cell frame of one row", "0/model/frame/rows: expected a number from 2 to 96",
     fact("0/model/frame/rows", 1), "factorised-4"},
    {"a cell frame without a pitch", "0/model/frame/pitch_m: expected a number from",
     fact("0/model/frame/pitch_m", 0.0), "factorised-4"},
    {"another constant of the method", "0/alignment/config/histogram_m: ",
     fact("0/alignment/config/histogram_m", 0.9), "factorised-4"},
    {"another whole number of the method",
     "0/alignment/config/directions: ", fact("0/alignment/config/directions", 64), "factorised-4"},
    {"a text with an escape sequence", "crafted: ",
     [](auto& m) { m.head["\x1b[2J"] = m.head[map_name], m.head["\x1b[2J"]["dtype"] = "\x1b[2J"; }},
    {"another format", "format: expected one of echofuse model", fact("format", "recipe")},
    {"a newer version", "use a newer echofuse", fact("format_version", 1000)},
    {"an older version", "train the model again", fact("format_version", 9)},
};

// Testing all kinds of models takes a minute, so it is done only by scripts/test_slow.
std::vector<std::string> kinds_tried() {
  if (std::getenv("ECHOFUSE_LONG")) return kinds;
  return {"factorised-4"};
}

}  // namespace

TEST_CASE("loading and saving a model again gives an identical file and identical maps") {
  const Folder dir;
  Dataset data = load({models() / "few"});
  const Rows rows = all_rows(data.size());
  for (const std::string& kind : kinds) {
    CAPTURE(kind);
    const Bytes whole = whole_file(kind);
    const TrainedModel model = load_model(models() / kind);
    CHECK(fault_of(whole).empty());
    save_model(model, dir / kind);
    const TrainedModel again = load_model(dir / kind);
    CHECK(again.predict(data, rows).values == model.predict(data, rows).values);
    std::filesystem::remove(dir / "twice");
    save_model(again, dir / "twice");
    CHECK(read_file(dir / "twice") == read_file(dir / kind));
    // The training log may differ from the original. It only informs the user and is not loaded.
    crafted::Model first(whole), second(read_file(dir / kind));
    for (crafted::Model* m : {&first, &second})
      for (const std::string& name : m->names_of_facts())
        if (name.find("/training/") != std::string::npos) m->facts.erase(name);
    CHECK(first.facts == second.facts);
  }
}

TEST_CASE("a maliciously crafted model file is refused with a one-line error") {
  for (const Hostile& h : hostile_files) {
    CAPTURE(h.what);
    crafted::Model model(whole_file(h.from));
    CHECK(fault_of(model.sealed()).empty());
    h.change(model);
    const std::string fault = fault_of(model.sealed());
    CHECK_THAT(fault, StartsWith("crafted: ") && Contains(h.saying));
    CHECK(fault.find('\x1b') == std::string::npos);
  }
}

TEST_CASE("a truncated, changed or old model file is refused with a one-line error") {
  const ReconFolder dir;
  const Bytes whole = whole_file("ridge");
  const auto resized = [&](std::size_t size) {
    Bytes out = whole;
    out.resize(size);
    return out;
  };
  // Returns the file with another length of the header.
  const auto with_length = [](Bytes file, std::uint64_t length) {
    std::memcpy(file.data(), &length, sizeof length);
    return file;
  };
  const auto bytes = [](const std::string& text) { return Bytes(text.begin(), text.end()); };
  const auto header = [](const std::string& text) { return crafted::sealed(text, {}); };
  const crafted::Model model(whole);
  nlohmann::json unsealed = model.head;
  unsealed["__metadata__"] = {{"facts", model.facts.dump()}};
  const std::string no_model = "not a model file", mismatch = "damaged: checksum mismatch",
                    no_checksum = "has no checksum", no_json = "invalid JSON header";
  const std::vector<std::tuple<const char*, Bytes, std::string>> files{
      {"an empty file", {}, no_model},
      {"seven bytes", resized(7), no_model},
      {"a huge header", with_length(whole, std::uint64_t{1} << 62), no_model},
      {"a header beyond the file", with_length(resized(500), 600), no_model},
      {"the last byte missing", resized(whole.size() - 1), mismatch},
      {"an extra byte", resized(whole.size() + 1), mismatch},
      {"no checksum", crafted::sealed(unsealed.dump(), model.values), no_checksum},
      {"a truncated checksum", header(R"({"crc32c":"0000)"), no_checksum},
      {"a header that is not JSON", header(R"({"crc32c":"00000000",)"), no_json},
      {"a header that is a list", header(R"([{"crc32c":"00000000"}])"), no_json},
      {"a deeply nested header", header(R"({"crc32c":"00000000","a":)" + std::string(500'000, '[')),
       no_json},
      {"facts that are not JSON", header(R"({"__metadata__":{"crc32c":"00000000","facts":"{"}})"),
       no_json},
      {"an old HDF5 file", bytes("\x89HDF\r\n\x1a\n" + std::string(4096, '\0')), no_model},
      {"an old safetensors file", bytes("ECHOFUSE" + std::string(504, '\0') + "\x89HDF\r\n\x1a\n"),
       "the model has an older format; train it again"}};
  for (const auto& [what, file, words] : files) {
    CAPTURE(what);
    CHECK_THAT(fault_of(file), StartsWith("crafted: ") && Contains(words));
    std::filesystem::remove(dir / "m");
    write_file(dir / "m", file);
    dir.refuses("evaluate m " + (models() / "few"), 1, words);
  }
  CHECK(dir.recon("evaluate /dev/zero " + (models() / "few")).code == 1);
  std::uint64_t length = 0;
  std::memcpy(&length, whole.data(), sizeof length);
  std::mt19937_64 random(3);
  for (int i = 0; i < 300; ++i) {
    // In a third of the trials, the changed byte is in the header.
    Bytes file = whole;
    std::uint8_t& byte = file[random() % (i % 3 == 0 ? 8 + length : file.size())];
    byte = static_cast<std::uint8_t>(byte ^ (1 + random() % 255));
    CAPTURE(&byte - file.data());
    CHECK_FALSE(fault_of(file).empty());
  }
}

TEST_CASE("overlapping tensors in a model file are refused before they are copied") {
  const std::size_t size = 1 << 20;
  nlohmann::json head;
  head["__metadata__"] = {{"crc32c", "00000000"}, {"facts", "{}"}};
  for (int i = 0; i < 3000; ++i)
    head["t" + std::to_string(i)] = {
        {"dtype", "U8"}, {"shape", {size}}, {"data_offsets", {0, size}}};
  const Bytes file = crafted::sealed(head.dump(), Bytes(size));
  const auto peak_kib = [] {
    rusage used{};
    ::getrusage(RUSAGE_SELF, &used);
    return used.ru_maxrss;
  };
  const auto before = peak_kib();
  CHECK_THROWS_WITH(TensorFile("crafted", file),
                    Contains("data_offsets: tensors overlap or leave a gap"));
  // The limit is 256 MiB. If all tensors were copied, the program would use 3 GB.
  CHECK(peak_kib() - before < 256 << 10);
}

TEST_CASE("a model file with an array of the wrong type or shape is refused") {
  for (const std::string& from : kinds_tried()) {
    const Bytes whole = whole_file(from);
    const crafted::Model model(whole);
    for (const std::string& name : model.tensors()) {
      // Tensors of the training log are not read.
      if (name.find("training/hidden") != std::string::npos) continue;
      CAPTURE(from, name);
      const auto after = [&](const Spoil& change) {
        crafted::Model changed(whole);
        change(changed);
        return fault_of(changed.sealed());
      };
      const auto shape = model.head[name]["shape"].get<std::vector<std::size_t>>();
      const std::string type = model.head[name]["dtype"];
      const std::size_t bytes = model.end_of(name) - model.begin_of(name);
      CHECK_THAT(after([&](auto& m) {
                   m.replace(name, type == "F32" ? "U32" : "F32", shape, 0, 0),
                       m.head[name]["shape"] = {0};
                 }),
                 Contains(name));
      CHECK_THAT(after([&](auto& m) {
                   m.replace(name, type, {1, 1, 1}, bytes == 0 ? 0 : 4, 0);
                 }),
                 Contains(name));
      // All bytes are set to 0xff, which gives NaN in floating-point types.
      const std::string fault = after([&](auto& m) { m.replace(name, type, shape, bytes, 0xff); });
      if (type[0] == 'F' && bytes > 0) CHECK_THAT(fault, Contains(name));
      // Each dimension is increased by one, decreased by one, or set to zero. The file must then be
      // rejected, or the model must predict maps.
      for (const std::size_t by : {std::size_t{1}, ~std::size_t{0}, std::size_t{0}}) {
        std::vector<std::size_t> other = shape;
        std::size_t count = type == "F64" || type == "I64" ? 8 : type == "U8" ? 1 : 4;
        for (std::size_t& side : other) side = by == 0 || side == 0 ? 0 : side + by, count *= side;
        after([&](auto& m) { m.replace(name, type, other, count, 0); });
      }
    }
  }
}

TEST_CASE("a model file with metadata of the wrong type is refused without a crash") {
  for (const std::string& from : kinds_tried()) {
    const crafted::Model whole(whole_file(from));
    CHECK(whole.names_of_facts().size() > 20);
    for (const std::string& name : whole.names_of_facts()) {
      // Metadata of the training log are not read.
      if (name.find("/training/") != std::string::npos) continue;
      CAPTURE(from, name);
      const auto with = [&](const nlohmann::json& value) {
        crafted::Model model = whole;
        model.facts[name] = value;
        return fault_of(model.sealed());
      };
      const nlohmann::json other =
          whole.facts[name].is_string() ? nlohmann::json(1) : nlohmann::json("text");
      for (const nlohmann::json& value : {nlohmann::json::array({1, 2}), nlohmann::json(), other})
        CHECK_THAT(with(value), Contains(name));
      with("");
      with(-1), with(INT64_MAX), with(1e17), with(-1e300), with(0.5);
    }
  }
}
