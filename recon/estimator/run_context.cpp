// SPDX-License-Identifier: MIT
#include "recon/estimator/run_context.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/exit_code.hpp"
#include "drivers/core/random.hpp"
#include "recon/numbers/matrix_file.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/uncertainty/domain_shift.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_laboratories = 50, least_records = 10;
constexpr std::size_t fewest_drawn = 5, most_drawn = 40;
constexpr double unknown_share = 0.3;
constexpr double most_deviations = 2.5;  // no laboratory is beyond what the training has seen
constexpr std::uint64_t context_stream = 0x636f6e74;  // "cont"

// Means of all columns, then standard deviations of those that tell shapes. Empty without a row.
std::vector<double> summary_of(const Matrix& observed, const Rows& rows) {
  if (rows.empty()) return {};
  const ColumnStatistics columns = column_statistics(observed, rows);
  std::vector<double> out = columns.mean;
  for (const std::size_t c : columns_of_shape(observed.cols))
    out.push_back(std::sqrt(columns.variance[c]));
  return out;
}

}  // namespace

std::vector<Rows> laboratories_of(const Dataset& data, const Rows& rows) {
  std::vector<Rows> out;
  for (const Source& source : data.sources) {
    const std::size_t count = source.laboratories, first = out.size();
    if (count < 2 || count > data.size()) continue;
    out.resize(first + count);
    for (const std::size_t row : rows)
      if (row >= source.first && row < source.first + source.count)
        out[first + static_cast<std::size_t>(data.index[row]) % count].push_back(row);
  }
  std::erase_if(out, [](const Rows& some) { return some.size() < least_records; });
  if (out.size() < least_laboratories) out.clear();
  return out;
}

RunContext::RunContext(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                       const std::vector<Rows>& laboratories, Inputs inputs, std::uint64_t seed,
                       Matrix& trained_with) {
  trained_with = {};
  Rng rng = make_rng(seed, context_stream);
  std::vector<Matrix> observed;
  Matrix all;
  for (const Rows& rows : laboratories) {
    observed.push_back(observe_shapes(alignment, data, aligned, rows, inputs));
    const auto found = summary_of(observed.back(), all_rows(observed.back().rows));
    if (found.empty()) continue;
    all.cols = found.size();
    all.add_row(std::vector<float>(found.begin(), found.end()));
  }
  if (all.rows < least_laboratories) return;
  const ColumnStatistics columns = column_statistics(all, all_rows(all.rows));
  usual_ = columns.mean;
  for (const double v : columns.variance) deviation_.push_back(std::max(std::sqrt(v), 1e-6));
  value_.assign(usual_.size(), 0);
  trained_with = Matrix(data.size(), size());
  std::bernoulli_distribution unknown(unknown_share);
  for (std::size_t l = 0; l < laboratories.size(); ++l) {
    Rows bodies = all_rows(observed[l].rows);
    for (const std::size_t row : laboratories[l]) {
      const std::size_t most = std::min(most_drawn, bodies.size());
      if (most < fewest_drawn || unknown(rng)) continue;
      std::shuffle(bodies.begin(), bodies.end(), rng);
      const std::size_t drawn = std::uniform_int_distribution<std::size_t>(fewest_drawn, most)(rng);
      const auto context = standardised(summary_of(
          observed[l], {bodies.begin(), bodies.begin() + static_cast<std::ptrdiff_t>(drawn)}));
      std::copy(context.begin(), context.end(), trained_with.row(row).begin());
    }
  }
}

std::vector<float> RunContext::standardised(const std::vector<double>& found) const {
  std::vector<float> out;
  for (std::size_t c = 0; c < found.size(); ++c)
    out.push_back(static_cast<float>(
        std::clamp((found[c] - usual_[c]) / deviation_[c], -most_deviations, most_deviations)));
  return out;
}

void RunContext::learn(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                       const Rows& rows, Inputs inputs) {
  if (size() == 0) return;
  const Matrix observed = observe_shapes(alignment, data, aligned, rows, inputs);
  if (observed.rows < fewest_drawn) return;  // as in training: not known
  const auto found = summary_of(observed, all_rows(observed.rows));
  if (found.size() != size())
    throw Error(ExitCode::failed, "the model's context has " + std::to_string(size()) +
                                      " numbers, not " + std::to_string(found.size()));
  value_ = standardised(found);
}

Matrix RunContext::before(const Matrix& table) const {
  if (size() == 0) return table;
  Matrix contexts(table.rows, size());
  for (std::size_t i = 0; i < table.rows; ++i)
    std::copy(value_.begin(), value_.end(), contexts.row(i).begin());
  return before(table, contexts);
}

Matrix RunContext::before(const Matrix& table, const Matrix& contexts) {
  Matrix out(table.rows, contexts.cols + table.cols);
  for (std::size_t i = 0; i < table.rows; ++i) {
    const auto row = out.row(i);
    std::copy(contexts.row(i).begin(), contexts.row(i).end(), row.begin());
    std::copy(table.row(i).begin(), table.row(i).end(), row.last(table.cols).begin());
  }
  return out;
}

void RunContext::save(record::H5File& file) const {
  if (size() == 0) return;
  file.write("context/usual", usual_, {size()});
  file.write("context/deviation", deviation_, {size()});
  file.write("context/value", value_, {size()});
}

void RunContext::load(const record::H5File& file) {
  *this = {};
  if (!file.has("context")) return;
  value_ = file.read<float>("context/value", {record::H5File::any});
  usual_ = file.read<double>("context/usual", {size()});
  deviation_ = file.read<double>("context/deviation", {size()});
  for (const double v : deviation_) require_sound(file, v > 0, "context/deviation", "all above 0");
  require_sound(file, size() <= 64, "context/value", "64 numbers at most");
}

}  // namespace echofuse::recon
