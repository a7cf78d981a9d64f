// SPDX-License-Identifier: MIT
#include "recon/output/onnx.hpp"

#include <algorithm>

#include "drivers/core/console.hpp"
#include "recon/files/text.hpp"
#include "recon/output/onnx_body.hpp"
#include "recon/output/onnx_layers.hpp"

namespace echofuse::recon {
namespace {

using namespace onnx;

void add_metadata(Message& model, const TrainedModel& trained) {
  const auto entry = [&](const std::string& key, const std::string& value) {
    model.message(14, Message().text(1, key).text(2, value));
  };
  const Features& f = trained.features;
  entry("inputs", name_of(f.inputs));
  entry("scaling", wants_alignment(trained.name) ? "aligned" : f.scaling);
  for (const Axis* axis : {&f.spd_axis, &f.radar_axis}) {
    if (axis == (f.inputs == Inputs::radar ? &f.spd_axis : nullptr)) continue;
    if (axis == (f.inputs == Inputs::spd ? &f.radar_axis : nullptr)) continue;
    entry(axis->name + "_axis",
          formatted("%s %s count %u start %.17g step %.17g", axis->quantity.c_str(),
                    axis->unit.c_str(), axis->count, axis->start, axis->step));
  }
}

}  // namespace

Bytes to_onnx(const TrainedModel& model, const std::string& path) {
  const Features& f = model.features;
  const Layers layers = model.model->layers();
  const auto body = model.model->body_layers();
  if (layers.empty() && !body)
    throw Error(ExitCode::failed, path + ": a model of kind \"" + model.name +
                                      "\" is no network; mlp, ridge, pca-mlp, silhouette and "
                                      "factorised can be exported");
  const std::uint32_t side = model.scene.grid.size;
  Graph graph;
  graph.input("record", {body ? body->centre.size() : f.count()});
  graph.output("depth_m", {side, side});
  std::string map;
  if (body) {
    map = add_body(graph, *body, "record");
  } else {
    std::vector<float> gain(f.count(), f.radar_gain);
    std::fill_n(gain.begin(), f.spd_count(), f.spd_gain);
    map = add_layers(graph, add_scaling(graph, "record", f.centre, gain), layers, "layer");
  }
  add_reshape(graph, map, "map_shape", {-1, side, side}, "depth_m");
  Message out;
  out.number(1, 6).text(2, "echofuse").text(3, version()).message(7, graph.finish("echofuse"));
  out.message(8, Message().number(2, 11));
  add_metadata(out, model);
  return out.wire();
}

}  // namespace echofuse::recon
