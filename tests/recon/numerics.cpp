// SPDX-License-Identifier: MIT
// Tests that models predict finite maps or are refused for any seed and learning rate, and that
// ridge regression handles nearly singular inputs.
#include <Eigen/SVD>

#include "recon/method/method.hpp"
#include "recon/network/regression.hpp"
#include "recon/numbers/components.hpp"
#include "world.hpp"

namespace {

const Dataset& plates() {
  static const Dataset data = load_plates(240);
  return data;
}

TrainOptions options_for(const std::string& model, std::uint64_t seed, double rate_factor) {
  TrainOptions o = quiet_options(model, model == "factorised" ? 8 : 20);
  if (model != "factorised") o.fit.hidden = {32, 16};
  o.fit.basis = model == "factorised" ? 4 : 16, o.fit.batch = 8;
  o.fit.learning_rate = candidate_of(model, {}).fit.learning_rate.value() * rate_factor;
  o.fit.seed = seed;
  return o;
}

// Trains a model and returns the mean IoU of the held-out records. Fails if a pixel is not finite.
// load_model() refuses weights that are not finite.
double iou_of(const TrainOptions& options) {
  const Folder dir;
  save_model(train(plates(), options), dir / "m");
  const TrainedModel model = load_model(dir / "m");
  REQUIRE(all_finite(model.predict(plates(), all_rows(plates().size())).values));
  return scores_of(model, plates(), model.rows_of(plates(), Subset::test))[metric_iou].mean;
}

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::MatrixXd in_double(const Matrix& m) {
  return Eigen::Map<const RowMajor>(m.values.data(), static_cast<Eigen::Index>(m.rows),
                                    static_cast<Eigen::Index>(m.cols))
      .cast<double>();
}

double farthest(const Matrix& a, const Eigen::MatrixXd& b) {
  return (in_double(a) - b).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("a hundred seeds and learning rates over two decades give finite weights and maps") {
  const bool longer = std::getenv("ECHOFUSE_LONG");
  for (const std::string name : {"mlp", "pca-mlp", "factorised"})
    for (const double factor : {0.1, 0.3, 1.0, 3.0, 10.0})
      for (std::uint64_t seed = 1; seed <= (longer ? 100u : factor == 1 ? 5u : 2u); ++seed) {
        CAPTURE(name, factor, seed);
        const double iou = iou_of(options_for(name, seed, factor));
        if (factor == 1) CHECK(iou > 0.25);
      }
}

TEST_CASE("training with a learning rate that is too high gives finite maps or an error") {
  int refused_at_most = 0;
  for (const std::string name : {"mlp", "pca-mlp", "factorised"})
    for (const double factor : {1e2, 1e3, 1e4, 1e6, 1e12})
      for (const double share : {0.0, 0.1}) {
        CAPTURE(name, factor, share);
        TrainOptions o = options_for(name, 1, factor);
        o.split.validation_share = share;
        try {
          const TrainedModel model = train(plates(), o);
          CHECK(all_finite(model.predict(plates(), {0, 1, 2}).values));
        } catch (const Error& error) {
          CHECK(error.code() == ExitCode::failed);
          CHECK_THAT(error.what(), Contains("learning_rate"));
          refused_at_most += factor == 1e12;
        }
      }
  CHECK(refused_at_most > 0);
}

TEST_CASE("a network that is never better than the mean map predicts the mean map") {
  Rng rng = make_rng(4, 0);
  std::normal_distribution<float> normal;
  Matrix x(80, 5), y(80, 3), opposite(80, 3);
  for (float& v : x.values) v = normal(rng);
  for (std::size_t i = 0; i < y.rows; ++i)
    for (std::size_t c = 0; c < y.cols; ++c)
      y.row(i)[c] = 7 + x.row(i)[c], opposite.row(i)[c] = 7 - x.row(i)[c];
  const Rows rows = all_rows(80);
  Regression regression;
  Training training = training_of(candidate_of("mlp", {}).fit);
  training.hidden = {16}, training.quiet = true;
  const TrainingLog log =
      regression.fit({x, y, rows}, {x, opposite, rows}, Spread::each, training, "");
  CHECK(log.best_epoch == 0);
  CHECK(log.loss.size() == training.patience);
  for (const float v : regression.predict(x).values) REQUIRE(v == Approx(7).margin(0.5));
}

TEST_CASE("principal components equal the singular vectors of the data") {
  Rng rng = make_rng(5, 0);
  std::normal_distribution<float> normal;
  Matrix table(60, 40);
  for (std::size_t i = 0; i < table.rows; ++i) {
    const float a = 9 * normal(rng), b = 5 * normal(rng), c = 3 * normal(rng);
    for (std::size_t k = 0; k < table.cols; ++k) {
      const auto at = static_cast<float>(k);
      table.row(i)[k] =
          2 + a * std::sin(at) + b * std::cos(2 * at) + c * std::sin(3 * at) + 0.1f * normal(rng);
    }
  }
  const Components found = principal_components(table, 3, 1);
  Eigen::MatrixXd dense = in_double(table);
  dense.rowwise() -= Eigen::RowVectorXd(dense.colwise().mean());
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(dense, Eigen::ComputeThinV);
  const Eigen::VectorXd along =
      (in_double(found.basis) * svd.matrixV().leftCols(3)).diagonal().cwiseAbs();
  for (Eigen::Index j = 0; j < 3; ++j) {
    CHECK(along(j) == Approx(1).margin(1e-4));
    CHECK(double{found.deviation[static_cast<std::size_t>(j)]} ==
          Approx(svd.singularValues()(j) / std::sqrt(60.0)).epsilon(1e-4));
  }
  CHECK(coordinates(found, table).cols == 3);
}

TEST_CASE("ridge regression equals the SVD solution for collinear inputs") {
  constexpr Eigen::Index n = 60, d = 12, pixels = 40;
  Rng rng = make_rng(9, 0);
  std::normal_distribution<double> normal;
  const auto random = [&](Eigen::Index rows, Eigen::Index cols) {
    return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return normal(rng); }));
  };
  const auto orthogonal = [&](Eigen::Index rows, Eigen::Index cols) -> Eigen::MatrixXd {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(random(rows, cols), Eigen::ComputeThinU);
    return svd.matrixU();
  };
  // The condition number of the inputs ranges from 1e4 to 1e14, although single precision resolves
  // only 1e7. If `condition` is 0, the inputs have rank 5 of 12. Tests more and fewer records than
  // inputs, and maps with and without noise.
  for (const double condition : {1e4, 1e8, 1e14, 0.0})
    for (const Eigen::Index records : {n, d / 2})
      for (const double noise : {0.0, 0.1}) {
        CAPTURE(condition, records, noise);
        Eigen::VectorXd s(d);
        for (Eigen::Index k = 0; k < d; ++k)
          s(k) = condition > 0 ? std::pow(condition, -static_cast<double>(k) / (d - 1))
                               : static_cast<double>(k < 5);
        const RowMajor x = (orthogonal(n, d) * s.asDiagonal() * orthogonal(d, d).transpose() * 10)
                               .topRows(records)
                               .cast<float>();
        const RowMajor y =
            (x.cast<double>() * random(d, pixels) + noise * random(records, pixels)).cast<float>();
        Matrix inputs(static_cast<std::size_t>(records), d);
        Matrix maps(inputs.rows, pixels);
        std::copy_n(x.data(), x.size(), inputs.values.begin());
        std::copy_n(y.data(), y.size(), maps.values.begin());
        const auto ridge = kind_of("ridge").make();
        ridge->fit({inputs, maps, all_rows(inputs.rows)}, {inputs, maps, {}}, {});
        TensorFile file;
        ridge->archive({file, Archive::Direction::write}, {d, pixels, {}});
        const double penalty = std::get<double>(file.facts.at("penalty"));

        const Eigen::RowVectorXd mean = x.cast<double>().colwise().mean();
        const Eigen::MatrixXd centred = x.cast<double>().rowwise() - mean;
        const Eigen::RowVectorXd level = y.cast<double>().colwise().mean();
        const Eigen::JacobiSVD<Eigen::MatrixXd> svd(centred,
                                                    Eigen::ComputeThinU | Eigen::ComputeThinV);
        const Eigen::ArrayXd sv = svd.singularValues().array();
        const Eigen::VectorXd shrink =
            (sv > 1e-12 * sv(0)).select(sv / (sv.square() + penalty), 0.0);
        const Eigen::MatrixXd w = svd.matrixV() * shrink.asDiagonal() * svd.matrixU().transpose() *
                                  (y.cast<double>().rowwise() - level);
        const double scale = y.cwiseAbs().maxCoeff();
        // The predictions are compared for the training records and for records that were not used
        // in training.
        Matrix others = inputs;
        for (float& v : others.values) v += static_cast<float>(normal(rng));
        for (const Matrix& asked : {inputs, others}) {
          const Eigen::MatrixXd expected =
              ((in_double(asked).rowwise() - mean) * w).rowwise() + level;
          const double size = std::max(scale, expected.cwiseAbs().maxCoeff());
          const double off = farthest(ridge->predict(asked), expected) / size;
          CAPTURE(penalty, size);
          CHECK(off < 1e-5);
        }
      }
}
