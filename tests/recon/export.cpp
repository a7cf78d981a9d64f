// SPDX-License-Identifier: MIT
// What `export` writes, as others read it: the network by OpenCV's dnn, the records by read_npy.
#include <fstream>
#include <opencv2/dnn.hpp>

#include "recon/estimator/train.hpp"
#include "recon/output/export_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::Folder;
using echofuse::testing::write_run;

namespace {

// A model of every scaling and of each kind that can be exported, on file.
void train_into(const std::string& path, const Dataset& data, const std::string& model,
                const std::string& inputs, const std::string& scaling) {
  TrainOptions options;
  options.uncertainty = false;
  options.model = model, options.inputs = inputs, options.scaling = scaling;
  options.fit.hidden = {48, 24, 16};
  options.fit.epochs = 4, options.fit.batch = 16, options.fit.quiet = true;
  save_model(train(data, options), path);
}

Matrix by_opencv(const std::string& onnx, Matrix records) {
  cv::dnn::Net net = cv::dnn::readNetFromONNX(onnx);
  net.setInput(cv::Mat(static_cast<int>(records.rows), static_cast<int>(records.cols), CV_32F,
                       records.values.data()),
               "record");
  const cv::Mat out = net.forward("depth_m");
  Matrix maps(records.rows, out.total() / records.rows);
  REQUIRE(out.isContinuous());
  std::copy_n(out.ptr<float>(), out.total(), maps.values.begin());
  return maps;
}

}  // namespace

TEST_CASE("OpenCV's dnn makes the same maps of an exported network") {
  const Folder dir;
  write_run(dir / "run", 80);
  const Dataset data = load({dir / "run"});
  const Rows many{3, 0, 79, 41, 41}, one{7};
  for (const std::string kind : {"mlp", "ridge", "pca-mlp"})
    for (const std::string inputs : {"fused", "spd", "radar"})
      for (const std::string& scaling : scaling_names) {
        CAPTURE(kind, inputs, scaling);
        train_into(dir / "m", data, kind, inputs, scaling);
        export_model(dir / "m", {}, dir / "x.onnx");
        const TrainedModel model = load_model(dir / "m");
        for (const Rows& rows : {many, one}) {
          const Matrix ours = model.predict(data, rows);
          const Matrix theirs =
              by_opencv(dir / "x.onnx", model.features.normalised_inputs(data, rows));
          REQUIRE(theirs.cols == ours.cols);
          double worst = 0;
          for (std::size_t i = 0; i < ours.values.size(); ++i)
            worst = std::max(worst, std::abs(double{ours.values[i]} - double{theirs.values[i]}));
          CHECK(worst < 1e-4);
        }
      }
}

TEST_CASE("OpenCV's dnn places and draws the same body") {
  const Folder dir;
  write_run(dir / "run", 80, 1, [](record::FusedRecord& r) {
    if (r.index != 41) return;  // nobody
    for (std::size_t i = 0; i < r.spd.size(); ++i) r.spd[i] = 1 + i % 2;
  });
  const Dataset data = load({dir / "run"});
  const Rows rows = all_rows(data.size());
  for (const std::string kind : {"factorised", "silhouette"}) {
    CAPTURE(kind);
    train_into(dir / "m", data, kind, "fused", "record");
    export_model(dir / "m", {}, dir / "x.onnx");
    const TrainedModel model = load_model(dir / "m");
    const Matrix ours = model.predict(data, rows);
    const Matrix inputs = model.inputs(data, rows, model.align(data, rows, true));
    const Matrix theirs = by_opencv(dir / "x.onnx", inputs);
    REQUIRE(theirs.cols == ours.cols);
    // A pixel whose mask is as high as the threshold may fall on either side of it.
    std::size_t other = 0, bodies = 0;
    for (std::size_t i = 0; i < ours.rows; ++i)
      for (std::size_t p = 0; p < ours.cols; ++p) {
        const double difference = double{ours.row(i)[p]} - double{theirs.row(i)[p]};
        other += !(std::abs(difference) < 1e-4);
        bodies += ours.row(i)[p] != model.scene.background[p];
      }
    CHECK(bodies > 1000);
    CHECK(other <= bodies / 2000);
    CHECK(std::equal(theirs.row(41).begin(), theirs.row(41).end(), model.scene.background.begin()));
    CHECK(by_opencv(dir / "x.onnx", take_rows(inputs, {7})).rows == 1);
  }
}

TEST_CASE("what cannot be exported is said") {
  const Folder dir;
  write_run(dir / "run", 30);
  for (const std::string kind : {"nearest", "mean"}) {
    train_into(dir / "m", load({dir / "run"}), kind, "fused", "record");
    CHECK_THROWS_WITH(export_model(dir / "m", {}, dir / "x.onnx"),
                      Catch::Contains("m: a model of kind \"" + kind +
                                      "\" is no network; mlp, ridge, pca-mlp, silhouette and"));
  }
  CHECK_THROWS_WITH(export_model(dir / "m", {}, dir / "x.pt"), Catch::Contains(".onnx or .npz"));
  CHECK_THROWS_WITH(export_model(dir / "m", {}, dir / "x.npz"), Catch::Contains("--run"));
  CHECK_THROWS_WITH(export_model(dir / "run", {}, dir / "x.onnx"), Catch::Contains(dir / "run"));
  CHECK_FALSE(std::filesystem::exists(dir / "x.onnx"));
}

TEST_CASE("exported records are the network's input, with their part in the training") {
  const Folder dir;
  write_run(dir / "run", 50, 1, [](record::FusedRecord& r) {
    if (r.index == 9) r.valid.erase(Sensor::spd), r.spd.clear();
  });
  const Dataset data = load({dir / "run"});
  train_into(dir / "m", data, "mlp", "fused", "record");
  const TrainedModel model = load_model(dir / "m");
  export_model(dir / "m", {dir / "run"}, dir / "x.npz");
  const Rows test = model.rows_of(data, Part::test);
  REQUIRE(test.size() == 5);
  const Matrix first = model.features.normalised_inputs(data, {test[0]});
  std::string command = "/usr/bin/python3 -c \"import numpy as n; a = n.load('" + (dir / "x.npz") +
                        "'); t = a['part'] == 2; print(len(a['index']), 9 in a['index'], "
                        "n.bincount(a['part']).tolist(), a['index'][t].tolist(), "
                        "'%.6g' % a['record'][t][0, 20], '%.6g' % a['depth_m'][t].mean())\" > " +
                        (dir / "out");
  REQUIRE(std::system(command.c_str()) == 0);
  std::ifstream in(dir / "out");
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  double mean = 0;
  std::string indices;
  for (const std::size_t row : test) {
    indices += (indices.empty() ? "" : ", ") + std::to_string(data.index[row]);
    for (const float d : data.depth.row(row)) mean += double{d} / 4096 / 5;
  }
  CHECK_THAT(text, Catch::StartsWith("49 False [42, 2, 5] [" + indices + "] "));
  double value = 0, depth = 0;
  REQUIRE(std::sscanf(text.c_str() + text.find("] ", text.find("] ") + 1) + 2, "%lf %lf", &value,
                      &depth) == 2);
  CHECK(value == Approx(double{first.values[20]}).epsilon(1e-5));
  CHECK(depth == Approx(mean).epsilon(1e-5));
}

TEST_CASE("exported records of a model that places a body are what it takes") {
  const Folder dir;
  write_run(dir / "run", 40);
  const Dataset data = load({dir / "run"});
  train_into(dir / "m", data, "silhouette", "fused", "record");
  const TrainedModel model = load_model(dir / "m");
  const Matrix inputs = model.inputs(data, {7}, model.align(data, {7}, true));
  export_model(dir / "m", {dir / "run"}, dir / "x.npz");
  const std::string command = "/usr/bin/python3 -c \"import numpy as n; a = n.load('" +
                              (dir / "x.npz") + "')['record']; print(a.shape, *a[7])\" > " +
                              (dir / "out");
  REQUIRE(std::system(command.c_str()) == 0);
  std::ifstream in(dir / "out");
  std::string shape;
  std::getline(in, shape, ')');
  CHECK(shape == "(40, " + std::to_string(inputs.cols));
  for (const float expected : inputs.values) {
    float value = 0;
    in >> value;
    CHECK(value == Approx(expected));
  }
}
