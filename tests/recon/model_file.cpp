// SPDX-License-Identifier: MIT
// Model files that came by mail: cut off, changed on the way, or made by somebody on purpose.
#include <sys/resource.h>

#include <cstdlib>
#include <random>

#include "crafted.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;
namespace fs = std::filesystem;

namespace {

// Three models that together have everything that a file can hold: a factorised one with a range
// bias's reference and its uncertainty, a ridge regression, and a small network with a fallback.
const Folder& models() {
  static const Folder dir;
  static const bool made = [] {
    write_run(dir / "run", 700);
    const Dataset data = load({dir / "run"});
    const std::pair<const char*, const char*> kinds[] = {{"factorised", "factorised"},
                                                         {"ridge", "ridge"},
                                                         {"mlp", "mlp-12-10"},
                                                         {"nearest", "nearest-3"},
                                                         {"empty", "empty"}};
    for (const auto& [file, kind] : kinds) {
      TrainOptions o;
      o.model = kind;
      o.fit.epochs = 2, o.fit.quiet = true;
      o.uncertainty = file == std::string("factorised");
      o.range_bias = o.uncertainty;
      TrainedModel model = train(data, o);
      if (file == std::string("mlp")) {
        o.model = "pca-mlp-6-5", o.inputs = "spd";
        model.fallback = std::make_unique<TrainedModel>(train(data, o));
      }
      save_model(model, dir / file);
    }
    write_run(dir / "few", 4, 5);
    return true;
  }();
  REQUIRE(made);
  return dir;
}

struct Crafted {
  std::string path;
  Crafted(const Folder& dir, const std::string& from, const crafted::Edit& change)
      : path(dir / "crafted") {
    fs::copy_file(models() / from, path, fs::copy_options::overwrite_existing);
    REQUIRE(crafted::edit(path, change));
  }
};

// While it lives: of programs that are started, so little that 2^28 values end them. A sanitizer's
// shadow alone takes more.
struct LittleMemory {
  rlimit before{};
  LittleMemory() {
    getrlimit(RLIMIT_AS, &before);
    rlimit little = before;
    little.rlim_cur = std::min(before.rlim_cur, rlim_t{1'000'000'000});
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    setrlimit(RLIMIT_AS, &little);
#endif
  }
  ~LittleMemory() { setrlimit(RLIMIT_AS, &before); }
  LittleMemory(const LittleMemory&) = delete;
  LittleMemory& operator=(const LittleMemory&) = delete;
};

// Each command that reads models.
void programs_refuse(const std::string& path, const std::string& saying) {
  const Folder dir;
  const std::string run = models() / "few";
  for (const std::string& arguments :
       {"evaluate " + path + " " + run,
        "reconstruct -q " + path + " " + run + " --out " + (dir / "o"),
        "export " + path + " --to " + (dir / "x.onnx")}) {
    CAPTURE(arguments);
    const LittleMemory limit;
    const Outcome o = recon_program(arguments);
    CHECK(o.code == 1);
    CHECK_THAT(o.text, Catch::Contains(path) && Catch::Contains(saying));
    CHECK(std::count(o.text.begin(), o.text.end(), '\n') == 1);
  }
  CHECK_FALSE(fs::exists(dir / "o"));
  CHECK_FALSE(fs::exists(dir / "x.onnx"));
}

// What the file's text says that is wrong; empty if it is taken, and then it must also answer.
std::string fault_of(const std::string& path, const Dataset& data) {
  try {
    const TrainedModel model = load_model(path);
    Dataset own = data;
    model.match(own);
    const Prediction found =
        predict(model, own, all_rows(own.size()),
                model.uncertainty ? PredictionDetail::pixels : PredictionDetail::uncertainty);
    REQUIRE(found.maps.values.size() == own.size() * 4096);
    return {};
  } catch (const Error& error) {
    CHECK(error.code() == ExitCode::failed);
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
    return error.what();
  }
}

const hid_t f32 = H5T_IEEE_F32LE;

// All kinds take a minute: the long form of the test (scripts/test_slow).
std::vector<const char*> kinds_tried() {
  if (std::getenv("ECHOFUSE_LONG")) return {"factorised", "ridge", "mlp", "nearest", "empty"};
  return {"factorised"};
}

}  // namespace

TEST_CASE("models load, answer as before, and are the same file again") {
  const Folder dir;
  const Dataset data = load({models() / "few"});
  for (const char* name : {"factorised", "ridge", "mlp", "nearest", "empty"}) {
    CAPTURE(name);
    CHECK(fault_of(models() / name, data).empty());
    TrainedModel model = load_model(models() / name);
    model.fit = {};
    save_model(model, dir / name);
    CHECK(load_model(dir / name).predict(data, {0, 1, 2, 3}).values ==
          model.predict(data, {0, 1, 2, 3}).values);
  }
}

TEST_CASE("one line says what of a crafted model file is wrong") {
  const Folder dir;
  const auto refused = [&](const char* from, const std::string& saying,
                           const crafted::Edit& change) {
    programs_refuse(Crafted(dir, from, change).path, saying);
  };
  refused("ridge", ".@train_s: expected one number", [](hid_t file) {
    const std::vector<double> many(200, 0.5);
    crafted::replace_attribute(file, ".", "train_s", H5T_IEEE_F64LE, many.data(), many.size());
  });
  refused("ridge", "scene/background_m: has the shape 4095; expected 4096",
          [](hid_t file) { crafted::replace_array(file, "scene/background_m", f32, {4095}, 0); });
  refused("ridge", "split/run: asks for more values than the file holds", [](hid_t file) {
    crafted::replace_array(file, "split/run", H5T_STD_U32LE, {hsize_t{1} << 28});
  });
  refused("ridge", "fallback: is linked more than once", [](hid_t file) {
    H5Lcreate_hard(file, "/", file, "fallback", H5P_DEFAULT, H5P_DEFAULT);
  });
  refused("ridge", "fallback: is a soft or external link",
          [](hid_t file) { H5Lcreate_soft("/", file, "fallback", H5P_DEFAULT, H5P_DEFAULT); });
  refused("ridge", "fallback: is a soft or external link", [](hid_t file) {
    H5Lcreate_external("/etc/passwd", "/", file, "fallback", H5P_DEFAULT, H5P_DEFAULT);
  });
  refused("mlp", "model/layer1/biases: has the shape 10; expected 11", [](hid_t file) {
    crafted::replace_array(file, "model/layer1/weights", f32, {12, 11}, 0);
  });
}

TEST_CASE("a model file that was cut off, changed or written before is refused in one line") {
  const Folder dir;
  const std::string whole = contents(models() / "ridge"), path = dir / "m";
  const auto put = [&](const std::string& text) { std::ofstream(path, std::ios::binary) << text; };
  put(whole.substr(0, whole.size() - 1));
  programs_refuse(path, "it was cut off or changed");
  put(whole.substr(0, 300));
  programs_refuse(path, "it was cut off or changed");
  put(whole.substr(0, 5));
  programs_refuse(path, "not an echofuse model file");
  put(whole.substr(512));
  programs_refuse(path, "an HDF5 file without a checksum");
  CHECK(recon_program("evaluate /dev/zero " + (models() / "few")).code == 1);
  put(whole);
  fs::resize_file(path, std::uintmax_t{1} << 40);
  programs_refuse(path, "it was cut off or changed");
}

TEST_CASE("no flipped byte of a model file is read") {
  const Folder dir;
  const std::string whole = contents(models() / "ridge");
  std::mt19937_64 random(3);
  for (int i = 0; i < 200; ++i) {
    std::string text = whole;
    // A quarter of them within the seal.
    const std::size_t at = random() % (i % 4 == 0 ? 512 : text.size());
    text[at] = static_cast<char>(text[at] ^ static_cast<char>(1 + random() % 255));
    CAPTURE(at);
    std::ofstream(dir / "m", std::ios::binary) << text;
    if (i % 20 == 0)
      programs_refuse(dir / "m", ": ");
    else
      CHECK_THROWS_AS(load_model(dir / "m"), Error);
  }
}

TEST_CASE("no array of another type or extent is read") {
  const Folder dir;
  const Dataset data = load({models() / "few"});
  std::size_t tried = 0;
  for (const char* from : kinds_tried()) {
    crafted::Names names;
    Crafted(dir, from, [&](hid_t file) { names = crafted::names_of(file); });
    for (const std::string& name : names.arrays) {
      const auto after = [&](const std::function<void(hid_t, std::vector<hsize_t>)>& change) {
        const Crafted one(dir, from, [&](hid_t f) { change(f, crafted::extent_of(f, name)); });
        ++tried;
        return fault_of(one.path, data);
      };
      CAPTURE(from, name);
      const bool read = name.find("training/hidden") == std::string::npos;
      const bool texts = name.ends_with("split/runs");
      const bool floats = !texts && name.find("split/") == std::string::npos && read;
      const auto replace = [&](hid_t type, const std::vector<hsize_t>& extent, int fill) {
        return [=](hid_t file, const std::vector<hsize_t>&) {
          crafted::replace_array(file, name, type, extent, fill);
        };
      };
      CHECK_THAT(after(replace(f32, {hsize_t{1} << 28}, -1)), Catch::Contains(name));
      CHECK_THAT(after(replace(f32, {hsize_t{1} << 40, hsize_t{1} << 40}, -1)),
                 Catch::Contains(name));
      CHECK_THAT(after(replace(H5T_IEEE_F32BE, {4}, 0)), Catch::Contains(name));
      if (!read) continue;
      CHECK_THAT(after(replace(f32, {3, 3, 3}, 0)), Catch::Contains(name));
      CHECK_THAT(after(replace(H5T_STD_I16LE, {4}, 0)), Catch::Contains(name));
      if (!texts) CHECK_THAT(after(replace(H5T_C_S1, {4}, 0)), Catch::Contains(name));
      // 0xff in every byte: no number, for those that are floating point ones.
      bool empty = false;
      const std::string fault = after([&](hid_t file, const std::vector<hsize_t>& extent) {
        const hid_t set = H5Dopen2(file, name.c_str(), H5P_DEFAULT), type = H5Dget_type(set);
        H5Dclose(set);
        empty = std::find(extent.begin(), extent.end(), 0u) != extent.end();
        if (!texts) crafted::replace_array(file, name, type, extent, 0xff);
        H5Tclose(type);
      });
      if (floats && !empty) CHECK_THAT(fault, Catch::Contains(name));
      // One more of each side, and none: refused, or an answer.
      for (const int by : {1, -1, 0})
        after([&](hid_t file, std::vector<hsize_t> extent) {
          for (hsize_t& n : extent) n = by == 0 ? 0 : n + static_cast<hsize_t>(by);
          if (!texts) crafted::replace_array(file, name, f32, extent, 0);
        });
    }
  }
  CHECK(tried > 100);
}

TEST_CASE("no attribute of another type or extent is read, and no value of it ends the program") {
  const Folder dir;
  const Dataset data = load({models() / "few"});
  for (const char* from : kinds_tried()) {
    crafted::Names names;
    Crafted(dir, from, [&](hid_t file) { names = crafted::names_of(file); });
    CHECK(names.attributes.size() > 20);
    for (const auto& one : names.attributes) {
      const std::string object = one.first, attribute = one.second;
      CAPTURE(from, object, attribute);
      const auto with = [&](hid_t type, const void* values, hsize_t count = 0) {
        return fault_of(Crafted(dir, from,
                                [&](hid_t file) {
                                  crafted::replace_attribute(file, object, attribute, type, values,
                                                             count);
                                })
                            .path,
                        data);
      };
      const std::vector<double> many(200, 1.0);
      CHECK_THAT(with(H5T_IEEE_F64LE, many.data(), many.size()), Catch::Contains(attribute));
      const char* text = "text";
      const hid_t any_length = H5Tcopy(H5T_C_S1);
      H5Tset_size(any_length, H5T_VARIABLE);
      CHECK_THAT(with(any_length, &text), Catch::Contains(attribute));
      H5Tclose(any_length);
      with(H5T_C_S1, "x");
      for (const double value : {-1.0, 1e17, std::nan("")}) with(H5T_IEEE_F64LE, &value);
      for (const std::int64_t value : {std::int64_t{-1}, INT64_MAX}) with(H5T_STD_I64LE, &value);
    }
  }
}
