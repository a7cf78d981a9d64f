// SPDX-License-Identifier: MIT
// Tests the loading of untrusted model files, which may be truncated, corrupted or malicious.

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
  const char *what, *from, *saying;
  Spoil change;
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
    {"an offset beyond the end", "ridge", "crafted: zz: its data extend beyond the end of the file",
     beside("U8", 0, 8, 0)},
    {"reversed offsets", "ridge", "crafted: zz: its data extend beyond the end of the file",
     [](auto& m) { m.add("zz", "U8", {1}, 9, 8); }},
    {"a fractional offset", "ridge", "zz: expected whole numbers",
     [](auto& m) { m.add("zz", "U8", {1}, 0, 1), m.head["zz"]["data_offsets"][1] = 1e300; }},
    {"an overlap", "ridge", "data_offsets: tensors overlap or leave a gap",
     [](auto& m) { m.add("zz", "U8", {4}, 0, 4); }},
    {"a gap", "ridge", "data_offsets: tensors overlap or leave a gap", beside("U8", 4, 8, 8)},
    {"unassigned bytes", "ridge", "data_offsets: the file contains bytes that belong to no tensor",
     beside("U8", 0, 4, 8)},
    {"a shape that is too small", "ridge", "the data size does not match the shape 4095",
     shape_of(map_name, {4095})},
    {"a shape beyond any memory", "ridge", "the data size does not match the shape",
     shape_of(map_name, {9e14, 9e14, 9e14})},
    {"a negative dimension", "ridge", "0/scene/background_m: expected whole numbers",
     shape_of(map_name, {-4096})},
    {"five dimensions", "ridge", "0/scene/background_m: has 5 dimensions; expected at most 4",
     shape_of(map_name, {1, 1, 1, 1, 4096})},
    {"another shape", "ridge", "0/scene/background_m: has shape 64 x 64; expected 4096",
     shape_of(map_name, {64, 64})},
    {"an unknown type", "ridge", "0/scene/background_m: type F16; expected F32",
     [](auto& m) { m.head[map_name]["dtype"] = "F16"; }},
    {"another type", "ridge", "0/scene/background_m: has type U32; expected F32",
     [](auto& m) { m.head[map_name]["dtype"] = "U32"; }},
    {"NaN", "ridge", map_fault, first_value(map_name, std::nanf(""))},
    {"an infinite number", "ridge", map_fault, first_value(map_name, INFINITY)},
    {"a NaN weight", "ridge", "0/model/weights: expected finite numbers",
     first_value("0/model/weights", std::nanf(""))},
    {"a huge weight", "ridge", "0/model/weights: expected finite numbers up to 1e18",
     first_value("0/model/weights", 2e18f)},
    {"a deviation of 0", "factorised-4", "0/model/deviation: expected positive values only",
     first_value("0/model/deviation", 0.f)},
    {"a missing tensor", "ridge", "0/model/weights: is missing",
     [](auto& m) { m.head["zz"] = m.head["0/model/weights"], m.head.erase("0/model/weights"); }},
    {"a missing fact", "ridge", "0/train_s: is missing",
     [](auto& m) { m.facts.erase("0/train_s"); }},
    {"a text for a number", "ridge", "0/train_s: expected a number", fact("0/train_s", "long")},
    {"a number for a text", "ridge", "0/scaling: expected a string", fact("0/scaling", 3)},
    {"a fraction for a count", "ridge", "estimators: expected a whole number",
     fact("estimators", 1.5)},
    {"a list for a fact", "ridge", "0/train_s: expected a number or a string",
     fact("0/train_s", std::vector<int>{1, 2})},
    {"an unknown kind", "ridge", "0/model: expected one of", fact("0/model", "oracle")},
    {"no estimator", "ridge", "estimators: expected a number from 1 to 3", fact("estimators", 0)},
    {"four estimators", "ridge", "estimators: expected a number from 1 to 3",
     fact("estimators", 4)},
    {"a wrong number of estimators", "ridge", "1/", fact("estimators", 2)},
    {"an estimator with other axes", "mlp-12-10",
     "1/axes: expected the same axes as in the first estimator", fact("1/axes/spd/step", 401.0)},
    {"two fused estimators", "mlp-12-10", "1/", fact("1/inputs", "fused")},
    {"fewer bins than weights", "ridge", "0/features/centre: has shape 54; expected 53",
     fact("0/axes/spd/count", 29)},
    {"layers of different sizes", "mlp-12-10", "0/model/layer1/weights: expected shape 12 x 10",
     shape_of("0/model/layer1/weights", {10, 12})},
    {"another number of layers", "mlp-12-10", "0/model/",
     [](auto& m) { m.replace("0/model/widths", "I64", {2}, 16, 1); }},
    {"a cell frame of another size", "factorised-4", "0/model/",
     [](auto& m) {
       m.facts["0/model/frame/columns"] = m.facts["0/model/frame/columns"].template get<int>() + 1;
     }},
    {"a text with an escape sequence", "ridge", "crafted: ",
     [](auto& m) { m.head["\x1b[2J"] = m.head[map_name], m.head["\x1b[2J"]["dtype"] = "\x1b[2J"; }},
    {"another format", "ridge", "format: expected one of echofuse model", fact("format", "recipe")},
    {"a newer version", "ridge", "use a newer echofuse", fact("format_version", 1000)},
    {"an older version", "ridge", "train the model again", fact("format_version", 9)},
};

struct Spoilt {
  const char *what, *saying;
  std::function<Bytes(const Bytes&)> spoil;
};

Bytes text_file(const std::string& text) { return {text.begin(), text.end()}; }

Bytes with_length(const Bytes& whole, std::uint64_t length) {
  Bytes out = whole;
  std::memcpy(out.data(), &length, sizeof length);
  return out;
}

const std::vector<Spoilt> spoilt_files = {
    {"an empty file", "not a model file", [](const Bytes&) { return Bytes{}; }},
    {"seven bytes", "not a model file",
     [](const Bytes& w) { return Bytes(w.begin(), w.begin() + 7); }},
    {"a huge header", "not a model file",
     [](const Bytes& w) { return with_length(w, std::uint64_t{1} << 62); }},
    {"a header beyond the file", "not a model file",
     [](const Bytes& w) {
       return with_length({w.begin(), w.begin() + 500}, 600);
     }},
    {"the last byte missing", "damaged: checksum mismatch",
     [](const Bytes& w) { return Bytes(w.begin(), w.end() - 1); }},
    {"an extra byte", "damaged: checksum mismatch",
     [](const Bytes& w) {
       Bytes out = w;
       out.push_back(0);
       return out;
     }},
    {"no checksum", "has no checksum",
     [](const Bytes& w) {
       const crafted::Model m(w);
       nlohmann::json head = m.head;
       head["__metadata__"] = {{"facts", m.facts.dump()}};
       return crafted::sealed(head.dump(), m.values);
     }},
    {"a truncated checksum", "has no checksum",
     [](const Bytes&) { return crafted::sealed("{\"crc32c\":\"0000", {}); }},
    {"a header that is not JSON", "invalid JSON header",
     [](const Bytes&) { return crafted::sealed("{\"crc32c\":\"00000000\",", {}); }},
    {"a header that is a list", "invalid JSON header",
     [](const Bytes&) { return crafted::sealed("[{\"crc32c\":\"00000000\"}]", {}); }},
    {"a deeply nested header", "invalid JSON header",
     [](const Bytes&) {
       return crafted::sealed("{\"crc32c\":\"00000000\",\"a\":" + std::string(500'000, '['), {});
     }},
    {"facts that are not JSON", "invalid JSON header",
     [](const Bytes&) {
       return crafted::sealed("{\"__metadata__\":{\"crc32c\":\"00000000\",\"facts\":\"{\"}}", {});
     }},
    {"an old HDF5 file", "not a model file",
     [](const Bytes&) { return text_file("\x89HDF\r\n\x1a\n" + std::string(4096, '\0')); }},
    {"an old safetensors file", "the model has an older format; train it again",
     [](const Bytes&) {
       return text_file("ECHOFUSE" + std::string(504, '\0') + "\x89HDF\r\n\x1a\n");
     }},
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
    CHECK_THAT(fault, Catch::StartsWith("crafted: ") && Catch::Contains(h.saying));
    CHECK(fault.find('\x1b') == std::string::npos);
  }
}

TEST_CASE("a truncated, changed or old model file is refused with a one-line error") {
  const ReconFolder dir;
  const Bytes whole = whole_file("ridge");
  for (const Spoilt& s : spoilt_files) {
    CAPTURE(s.what);
    const Bytes file = s.spoil(whole);
    CHECK_THAT(fault_of(file), Catch::StartsWith("crafted: ") && Catch::Contains(s.saying));
    std::filesystem::remove(dir / "m");
    write_file(dir / "m", file);
    dir.refuses("evaluate m " + (models() / "few"), 1, s.saying);
  }
  CHECK(dir.recon("evaluate /dev/zero " + (models() / "few")).code == 1);
}

TEST_CASE("a flipped byte in a model file is detected") {
  const Bytes whole = whole_file("ridge");
  std::uint64_t length = 0;
  std::memcpy(&length, whole.data(), sizeof length);
  std::mt19937_64 random(3);
  for (int i = 0; i < 300; ++i) {
    Bytes file = whole;
    // In a third of the trials, the changed byte is in the header.
    const std::size_t at = random() % (i % 3 == 0 ? 8 + length : file.size());
    file[at] = static_cast<std::uint8_t>(file[at] ^ (1 + random() % 255));
    CAPTURE(at);
    CHECK_FALSE(fault_of(file).empty());
  }
}

TEST_CASE("a model file with an array of the wrong type or shape is refused") {
  for (const std::string& from : kinds_tried()) {
    const Bytes whole = whole_file(from);
    for (const std::string& name : crafted::Model(whole).tensors()) {
      CAPTURE(from, name);
      const auto after = [&](const Spoil& change) {
        crafted::Model model(whole);
        change(model);
        return fault_of(model.sealed());
      };
      const crafted::Model model(whole);
      const auto shape = model.head[name]["shape"].get<std::vector<std::size_t>>();
      const std::string type = model.head[name]["dtype"];
      const std::size_t bytes = model.end_of(name) - model.begin_of(name);
      // Tensors of the training log are not read.
      if (name.find("training/hidden") != std::string::npos) continue;
      CHECK_THAT(after([&](auto& m) {
                   m.replace(name, type == "F32" ? "U32" : "F32", shape, 0, 0),
                       m.head[name]["shape"] = {0};
                 }),
                 Catch::Contains(name));
      CHECK_THAT(after([&](auto& m) {
                   m.replace(name, type, {1, 1, 1}, bytes == 0 ? 0 : 4, 0);
                 }),
                 Catch::Contains(name));
      // All bytes are set to 0xff, which gives NaN in floating-point types.
      const std::string fault = after([&](auto& m) { m.replace(name, type, shape, bytes, 0xff); });
      if (type[0] == 'F' && bytes > 0) CHECK_THAT(fault, Catch::Contains(name));
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
      CHECK_THAT(with(nlohmann::json::array({1, 2})), Catch::Contains(name));
      CHECK_THAT(with(nullptr), Catch::Contains(name));
      if (whole.facts[name].is_string())
        CHECK_THAT(with(1), Catch::Contains(name));
      else
        CHECK_THAT(with("text"), Catch::Contains(name));
      with("");
      with(-1), with(INT64_MAX), with(1e17), with(-1e300), with(0.5);
    }
  }
}
