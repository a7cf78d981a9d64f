// SPDX-License-Identifier: MIT
#include "recon/models/model.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "drivers/util/exit_code.hpp"

namespace echofuse::recon {

namespace {

// Parses sizes such as "512-256". Returns an empty list if the string does not have this form.
std::vector<std::size_t> numbers_of(const std::string& text) {
  std::vector<std::size_t> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, '-');) {
    std::size_t value = 0;
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (error != std::errc{} || end != part.data() + part.size() || value == 0 || value > 65536)
      return {};
    out.push_back(value);
  }
  return out;
}

constexpr const char* paper_model = "mlp-512-256";
const FitOptions network{.hidden = {{512, 256}},
                         .epochs = 60,
                         .learning_rate = 2e-3,
                         .weight_decay = 0.7,
                         .patience = 15,
                         .batch = 64};
const FitOptions masked{.hidden = {{512, 512}},
                        .epochs = 30,
                        .learning_rate = 1e-3,
                        .weight_decay = 0.1,
                        .patience = 30,
                        .batch = 64};
// If there are at least this many records, the batch size is doubled. This does not reduce the
// accuracy of the maps, and shortens training by 25 %. If there are fewer records, the larger batch
// would reduce the accuracy.
constexpr std::size_t many_records = 3000;
const FitOptions placed{.basis = 16,
                        .epochs = 100,
                        .learning_rate = 3e-3,
                        .weight_decay = 0.3,
                        .patience = 100,
                        .batch = 64};

FitOptions with_basis(std::size_t basis, FitOptions options = {}) {
  options.basis = basis;
  return options;
}

bool takes(const std::string& name, ModelKind::InputKind what) {
  const auto& kinds = model_kinds();
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](const ModelKind& k) { return k.name == name && k.takes == what; });
}

template <class T>
void fill(std::optional<T>& option, const std::optional<T>& own) {
  if (!option) option = own;
}

}  // namespace

const std::vector<ModelKind>& model_kinds() {
  using enum ModelKind::InputKind;
  using enum ModelKind::Size;
  // Defined in the source files of this folder.
  using Make = std::unique_ptr<Model>();
  Make make_empty, make_mean, make_mean_shape, make_factorised, make_ridge, make_pca_mlp, make_mlp,
      make_mlp_mask, make_nearest;
  static const std::vector<ModelKind> kinds{
      {"empty", make_empty, nothing, fixed, {}},
      {"mean", make_mean, nothing, fixed, {}},
      {"mean-shape", make_mean_shape, aligned, fixed, placed},
      {"factorised", make_factorised, aligned, basis, placed},
      {"ridge", make_ridge, inputs, fixed, {}},
      {"pca-mlp", make_pca_mlp, inputs, hidden, with_basis(128, network)},
      {"mlp", make_mlp, inputs, hidden, network},
      {"mlp-mask", make_mlp_mask, inputs, hidden, masked, "root"},
      {"nearest", make_nearest, inputs, basis, with_basis(1)}};
  return kinds;
}

std::vector<std::string> model_names() {
  std::vector<std::string> out;
  for (const ModelKind& kind : model_kinds()) out.push_back(kind.name);
  return out;
}

std::string model_help() {
  std::string out;
  for (const ModelKind& kind : model_kinds()) {
    out += (out.empty() ? "" : ", ") + kind.name;
    if (kind.size != ModelKind::Size::fixed) out += "[-N]";
    if (kind.size == ModelKind::Size::hidden) out += "[-N...]";
  }
  return out + ", paper (" + paper_model + ")";
}

const ModelKind& kind_of(const std::string& name) {
  std::string known;
  for (const ModelKind& kind : model_kinds()) {
    if (kind.name == name) return kind;
    known += (known.empty() ? "" : ", ") + kind.name;
  }
  throw Error(ExitCode::usage, "model \"" + name + "\": expected one of " + known);
}

Candidate candidate_of(const std::string& name, const FitOptions& base, std::size_t records) {
  if (name == "paper") return candidate_of(paper_model, base, records);
  Candidate out{name, name, base};
  const auto digit = name.find_first_of("0123456789");
  const bool sized = digit != std::string::npos && digit > 1 && name[digit - 1] == '-';
  if (sized) out.model = name.substr(0, digit - 1);
  const ModelKind& kind = kind_of(out.model);
  const bool hidden = kind.size == ModelKind::Size::hidden;
  const bool basis = kind.size == ModelKind::Size::basis;
  const FitOptions& own = kind.own;
  auto batch = own.batch;
  auto learning_rate = own.learning_rate;
  if (hidden) {  // scales the learning rate with the square root of the batch size
    if (records >= many_records) *batch *= 2;
    const double times =
        static_cast<double>(base.batch.value_or(*batch)) / static_cast<double>(*own.batch);
    *learning_rate *= std::sqrt(std::max(times, 1.0));
  }
  fill(out.fit.hidden, own.hidden), fill(out.fit.basis, own.basis);
  fill(out.fit.epochs, own.epochs), fill(out.fit.patience, own.patience);
  fill(out.fit.learning_rate, learning_rate), fill(out.fit.weight_decay, own.weight_decay);
  fill(out.fit.batch, batch);
  if (!sized) return out;
  const auto numbers =
      name.back() == '-' ? std::vector<std::size_t>{} : numbers_of(name.substr(digit));
  if (numbers.empty() || !(hidden || (basis && numbers.size() == 1 && numbers[0] <= 1024)))
    throw Error(ExitCode::usage,
                "model \"" + name + "\": expected sizes, e.g. mlp-512-256 or factorised-16");
  if (hidden)
    out.fit.hidden = numbers;
  else
    out.fit.basis = numbers.front();
  return out;
}

bool ignores_inputs(const std::string& name) { return takes(name, ModelKind::InputKind::nothing); }

bool wants_alignment(const std::string& name) { return takes(name, ModelKind::InputKind::aligned); }

}  // namespace echofuse::recon
