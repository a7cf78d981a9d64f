// SPDX-License-Identifier: MIT
// Input: u8 which of the models that are trained at the start, then edits to its file, until the
// input ends: u8 kind, and what it needs. HDF5 makes the edits and the file is sealed again, so
// that they reach behind the checksum, to our own checks and what they let pass. Bytes that HDF5
// itself would not write are not among them: a flipped one is for the checksum, and HDF5 is not
// ours.
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>

#include "../recon/crafted.hpp"
#include "fuzz.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "recon/files/files.hpp"
#include "recon/numbers/parallel.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using fuzz::require;

namespace {

constexpr std::size_t spd_bins = 30, radar_bins_ = 24, pixels = 64 * 64;

// Plates at places that depend on their number, seen by both sensors.
Dataset plates(std::size_t count) {
  Dataset d;
  d.spd_axis = {"spd", "counts", "ps", spd_bins, 16000, 400, 1};
  d.radar_axis = {"radar", "power", "m", radar_bins_, 0, 0.25, 1};
  d.spd = Matrix(count, spd_bins), d.radar = Matrix(count, radar_bins_);
  d.depth = Matrix(count, pixels);
  const auto bump = [](double at, double centre, double width) {
    return static_cast<float>(std::exp(-std::pow((at - centre) / width, 2)));
  };
  for (std::size_t i = 0; i < count; ++i) {
    const double turn = static_cast<double>(i) * 0.618034;
    const double x = 2 * (turn - std::floor(turn)) - 1, z = 3 + static_cast<double>(i % 7) / 7;
    for (std::size_t b = 0; b < spd_bins; ++b)
      d.spd.row(i)[b] =
          std::round(2 + 2e4f * bump(d.spd_axis.at(static_cast<double>(b) + 0.5) / ps_per_m,
                                     std::hypot(x, z), 0.2));
    for (std::size_t b = 0; b < radar_bins_; ++b)
      d.radar.row(i)[b] =
          bump(d.radar_axis.at(static_cast<double>(b)), std::hypot(x + 0.5, z), 0.4) +
          0.002f * static_cast<float>((i * 7 + b * 5) % 11);
    const auto centre = static_cast<std::size_t>(32 + 20 * x / z * 3);
    for (std::size_t r = 20; r < 44; ++r)
      for (std::size_t c = centre - 4; c < centre + 4; ++c)
        d.depth.row(i)[r * 64 + c] = static_cast<float>(z);
    d.valid.push_back(7);
    d.index.push_back(static_cast<std::int64_t>(i));
    d.label.push_back("plate");
  }
  d.slot_end.resize(count), d.clicks_a_pulse.resize(count, 0.01), d.speckle.resize(count);
  d.sources.push_back({"plates", "00000000-0000-0000-0000-000000000000", 0, count});
  return d;
}

std::string file_name(const char* what) {
  return std::filesystem::temp_directory_path() /
         ("echofuse-fuzz-" + std::to_string(::getpid()) + what);
}

struct Base {
  Bytes contents{};
  crafted::Names names{};
};

Base make_base(const Dataset& data, const std::string& kind, bool whole) {
  TrainOptions how;
  how.model = kind;
  how.fit.epochs = 2, how.fit.quiet = true;
  how.split.validation_share = 0.25;
  how.range_bias = how.uncertainty = whole;
  TrainedModel model = train(data, how);
  if (kind.starts_with("mlp")) {
    how.model = "pca-mlp-6-5", how.inputs = "spd";
    model.fallback = std::make_unique<TrainedModel>(train(data, how));
  }
  const std::string path = file_name("-base");
  save_model(model, path);
  Base out;
  out.contents = read_file(path);
  crafted::edit(path, [&](hid_t file) { out.names = crafted::names_of(file); });
  std::remove(path.c_str());
  return out;
}

const Dataset& records() {
  static const Dataset all = plates(220);
  return all;
}

const std::vector<Base>& bases() {
  static const std::vector<Base> all = [] {
    set_threads(1);
    std::vector<Base> out;
    out.push_back(make_base(records(), "factorised-3", true));
    out.push_back(make_base(records(), "mlp-6-5", true));
    out.push_back(make_base(records(), "pca-mlp-8", false));
    out.push_back(make_base(records(), "nearest-3", false));
    out.push_back(make_base(records(), "silhouette", false));
    return out;
  }();
  return all;
}

template <class T>
const T& one_of(const std::vector<T>& all, std::size_t which) {
  return all[which % all.size()];
}

std::vector<hid_t> types() {
  return {H5T_IEEE_F32LE, H5T_IEEE_F64LE, H5T_STD_U8LE,   H5T_STD_U32LE,
          H5T_STD_I64LE,  H5T_STD_U64LE,  H5T_IEEE_F32BE, H5T_C_S1};
}

const std::vector<hsize_t> sides = {0,
                                    1,
                                    2,
                                    3,
                                    4,
                                    5,
                                    6,
                                    10,
                                    24,
                                    30,
                                    54,
                                    64,
                                    4095,
                                    4096,
                                    4097,
                                    4098,
                                    hsize_t{1} << 28,
                                    hsize_t{1} << 40};

class Editor {
 public:
  Editor(hid_t file, const crafted::Names& names, ByteReader& in)
      : file_(file), names_(names), in_(in) {}

  void edit() {
    switch (byte() % 8) {
      case 0:
        return array();
      case 1:
        return values();
      case 2:
        return attribute();
      case 3:
        return stored();
      case 4:
        return link();
      case 5:
        H5Ldelete(file_, object().c_str(), H5P_DEFAULT);
        return;
      case 6:
        H5Lmove(file_, object().c_str(), file_, object().c_str(), H5P_DEFAULT, H5P_DEFAULT);
        return;
      case 7: {
        const auto& [name, title] = one_of(names_.attributes, byte());
        H5Adelete_by_name(file_, name.c_str(), title.c_str(), H5P_DEFAULT);
      }
    }
  }

 private:
  std::uint8_t byte() { return in_.get<std::uint8_t>(); }

  std::string object() {
    const std::uint8_t which = byte();
    return which % 4 == 0 ? one_of(names_.groups, which / 4) : one_of(names_.arrays, which);
  }

  void array() {
    const std::string name = one_of(names_.arrays, byte());
    const hid_t type = one_of(types(), byte());
    std::vector<hsize_t> extent(byte() % 5);
    std::size_t bytes = H5Tget_size(type);
    for (hsize_t& n : extent) {
      n = one_of(sides, byte());
      bytes = bytes < (1u << 20) ? bytes * n : bytes;
    }
    crafted::replace_array(file_, name, type, extent, bytes < (1u << 20) ? byte() : -1);
  }

  // Numbers of an array as it is: one of them, or all.
  void values() {
    const hid_t set = H5Dopen2(file_, one_of(names_.arrays, byte()).c_str(), H5P_DEFAULT);
    if (set < 0) return;
    const hid_t type = H5Dget_type(set), space = H5Dget_space(set);
    const hssize_t points = H5Sget_simple_extent_npoints(space);
    const std::size_t width = H5Tget_size(type);
    const std::size_t count =
        points > 0 && points < (1 << 20) ? static_cast<std::size_t>(points) : 0;
    const bool all = byte() % 2 == 0;
    const std::size_t at = in_.get<std::uint16_t>();
    const auto value = number();
    std::vector<std::uint8_t> raw(count * width);
    if (count > 0 && width <= 8 &&
        H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) >= 0) {
      std::array<std::uint8_t, 8> one = as_type(value, type);
      for (std::size_t i = 0; i < count; ++i)
        if (all || i == at % count)
          std::copy_n(one.begin(), width, raw.begin() + static_cast<std::ptrdiff_t>(i * width));
      H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data());
    }
    H5Sclose(space);
    H5Tclose(type);
    H5Dclose(set);
  }

  // Of a size that matters, or any.
  double number() {
    const std::vector<double> some = {0,    -1,    1,   1e-30,    1e18, -1e18,
                                      3e38, 1e300, NAN, INFINITY, 7,    100};
    const std::uint8_t which = byte();
    return which < 128 ? one_of(some, which) : in_.get<double>();
  }

  static std::array<std::uint8_t, 8> as_type(double value, hid_t type) {
    std::array<std::uint8_t, 8> out{};
    const auto single = static_cast<float>(value);
    const auto whole =
        std::isfinite(value) && std::abs(value) < 9e18 ? static_cast<std::int64_t>(value) : -1;
    if (H5Tequal(type, H5T_IEEE_F32LE) > 0)
      std::memcpy(out.data(), &single, sizeof single);
    else if (H5Tequal(type, H5T_IEEE_F64LE) > 0)
      std::memcpy(out.data(), &value, sizeof value);
    else
      std::memcpy(out.data(), &whole, sizeof whole);
    return out;
  }

  void attribute() {
    const auto& [name, title] = one_of(names_.attributes, byte());
    const std::uint8_t kind = byte();
    const double value = number();
    if (kind % 5 < 2) {
      const hid_t type = kind % 5 == 0 ? H5T_IEEE_F64LE : H5T_STD_I64LE;
      crafted::replace_attribute(file_, name, title, type, as_type(value, type).data());
    } else if (kind % 5 == 2) {
      const std::vector<double> many(200, value);
      crafted::replace_attribute(file_, name, title, H5T_IEEE_F64LE, many.data(), kind % 200 + 1u);
    } else {
      const bool fixed = kind % 5 == 3;
      std::string text =
          one_of<std::string>({"", "x", "spd", "radar", "fused", "mlp", "ridge", "raw", "record",
                               "empty", "nearest", "factorised", "\x1b[2J", "m", "ps", "power"},
                              byte());
      const char* pointer = text.c_str();
      const hid_t type = H5Tcopy(H5T_C_S1);
      H5Tset_size(type, fixed ? text.size() + 1 : H5T_VARIABLE);
      crafted::replace_attribute(file_, name, title, type,
                                 fixed ? static_cast<const void*>(pointer) : &pointer);
      H5Tclose(type);
    }
  }

  // An array in chunks, compressed, or in another file.
  void stored() {
    const std::string name = one_of(names_.arrays, byte());
    const std::uint8_t kind = byte();
    const hid_t how = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t chunk = 64;
    if (kind % 3 < 2) H5Pset_chunk(how, 1, &chunk);
    if (kind % 3 == 1) H5Pset_deflate(how, 1);
    if (kind % 3 == 2) H5Pset_external(how, "/etc/passwd", 0, 64);
    crafted::replace_array(file_, name, H5T_IEEE_F32LE, {kind % 3 == 2 ? 16u : 4096u},
                           kind % 3 == 2 ? -1 : 0, how);
    H5Pclose(how);
  }

  void link() {
    const std::string to = one_of<std::string>({"fallback", "uncertainty", "range_bias",
                                                "model/layer7", "training/more", "\x1b[2J", "a/b"},
                                               byte());
    const std::uint8_t kind = byte();
    const std::string from = kind / 3 % 4 == 0 ? "/" : object();
    if (kind % 3 == 0)
      H5Lcreate_hard(file_, from.c_str(), file_, to.c_str(), H5P_DEFAULT, H5P_DEFAULT);
    if (kind % 3 == 1) H5Lcreate_soft(from.c_str(), file_, to.c_str(), H5P_DEFAULT, H5P_DEFAULT);
    if (kind % 3 == 2)
      H5Lcreate_external("/etc/passwd", from.c_str(), file_, to.c_str(), H5P_DEFAULT, H5P_DEFAULT);
  }

  hid_t file_;
  const crafted::Names& names_;
  ByteReader& in_;
};

// What the loader lets pass answers with numbers, or says that it cannot.
void check_answers(const TrainedModel& model) {
  static const Dataset few = plates(3);
  Dataset data = few;
  std::fill_n(data.radar.row(2).begin(), radar_bins_, 0.f);  // for a fallback
  model.match(data);
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (model.fault_of(data, row).empty()) rows.push_back(row);
  const Prediction found =
      predict(model, data, rows,
              model.uncertainty ? PredictionDetail::pixels : PredictionDetail::uncertainty);
  require(found.maps.values.size() == rows.size() * pixels, "there is a map of each record");
  for (const float v : found.maps.values) require(std::isfinite(v), "a map is made of numbers");
  for (const float v : found.deviation.values) require(v >= 0, "a deviation is one");
  for (const PredictionUncertainty& uncertainty : found.uncertainties)
    require(fuzz::is_printable(uncertainty.out_of_distribution.text()), "reasons can be printed");
  if (!model.range_bias.known()) return;
  std::vector<float> moved = model.range_bias.measure(
      model.alignment, data, model.align(data, all_rows(data.size()), true));
  moved.resize(60, moved.empty() ? 0.f : moved.front());
  const RangeBias range_bias = model.range_bias.judge(moved);
  require(fuzz::is_printable(range_bias.text(false)), "a range bias can be reported");
  subtract_range_offset(data, range_bias.bias_m);
}

}  // namespace

void fuzz::run(ByteView input) {
  static const TemporaryFile file{file_name("")};
  ByteReader in(input);
  const Base& base = one_of(bases(), in.get<std::uint8_t>());
  const bool flip = in.get<std::uint8_t>() == 255;
  const auto at = in.get<std::uint32_t>();
  const bool whole = !flip && in.left() == 0;
  write_file(file.path, base.contents);
  const auto edit_all = [&](hid_t opened) {
    Editor editor(opened, base.names, in);
    for (int i = 0; i < 8 && in.left() > 0; ++i) editor.edit();
  };
  require(crafted::edit(file.path, edit_all), "HDF5 opens what it wrote");
  if (flip) {
    Bytes changed = read_file(file.path);
    changed[at % changed.size()] ^= static_cast<std::uint8_t>(1 + at % 255);
    write_file(file.path, changed);
  }
  try {
    const TrainedModel model = load_model(file.path);
    require(!flip, "a changed byte is seen");
    check_answers(model);
  } catch (const Error& error) {
    require(!whole, "a model as it was trained is taken");
    require(error.code() == ExitCode::failed, "a fault is the file's");
    require(is_printable(error.what()) && std::strlen(error.what()) < 500, "and told in a line");
  }
}

// The models are trained before the first input: with the sanitizers that takes longer than an
// input may.
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  bases();
  return 0;
}
