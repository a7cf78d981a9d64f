// SPDX-License-Identifier: MIT
#include "recon/output/export_model.hpp"

#include <filesystem>

#include "recon/estimator/trained_model.hpp"
#include "recon/files/files.hpp"
#include "recon/files/npz.hpp"
#include "recon/output/onnx.hpp"

namespace echofuse::recon {
namespace {

void export_records(const TrainedModel& model, const std::vector<std::string>& runs,
                    const std::string& to) {
  const Features& f = model.features;
  Dataset data = load(runs);
  match_axes(data, f.spd_axis, f.radar_axis, f.inputs);
  match_array(data, f.array_axis);
  const Rows rows = data.usable(f.inputs);
  constexpr std::uint8_t not_seen = 255;
  std::vector<std::uint8_t> part_of(data.size(), not_seen), part;
  for (const Part p : {Part::train, Part::validation, Part::test})
    for (const std::size_t row : model.rows_of(data, p))
      part_of[row] = static_cast<std::uint8_t>(p);
  std::vector<std::int64_t> index;
  for (const std::size_t row : rows) {
    part.push_back(part_of[row]);
    index.push_back(data.index[row]);
  }
  const Matrix inputs = wants_alignment(model.name)
                            ? model.inputs(data, rows, model.align(data, rows, true))
                            : f.normalised_inputs(data, rows);
  NpzFile out(to);
  out.begin("record", "<f4", {inputs.cols});
  out.append<float>(inputs.values);
  out.begin("depth_m", "<f4", {data.map.size, data.map.size});
  for (const std::size_t row : rows) out.append<float>(data.depth.row(row));
  out.begin("index", "<i8", {});
  out.append(index);
  out.begin("part", "|u1", {});
  out.append(part);
  out.close();
}

}  // namespace

void export_model(const std::string& model, const std::vector<std::string>& runs,
                  const std::string& to) {
  const bool onnx = to.ends_with(".onnx"), npz = to.ends_with(".npz");
  if (!onnx && !npz) throw Error(ExitCode::usage, to + ": expected the ending .onnx or .npz");
  const std::vector<std::string> models{model};
  if (npz == runs.empty())
    throw Error(ExitCode::usage, to + ": --run belongs to .npz, which holds its records");
  for (const auto* inputs : {&runs, &models})
    for (const auto& input : *inputs)
      if (std::filesystem::exists(to) && std::filesystem::exists(input) &&
          std::filesystem::equivalent(to, input))
        throw Error(ExitCode::usage, to + ": is what is to be exported; give another --to");
  if (onnx)
    write_file(to, to_onnx(load_model(model), model));
  else
    export_records(load_model(model), runs, to);
}

}  // namespace echofuse::recon
