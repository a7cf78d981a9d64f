// SPDX-License-Identifier: MIT
#include "recon/models/model.hpp"

#include <charconv>
#include <sstream>

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {

std::unique_ptr<Model> make_model(const std::string& name) {
  if (name == "empty") return make_background();
  if (name == "mean") return make_mean();
  if (name == "nearest") return make_nearest();
  if (name == "ridge") return make_ridge();
  if (name == "mlp") return make_mlp();
  if (name == "pca-mlp") return make_pca(make_mlp());
  if (name == "silhouette") return make_silhouette();
  if (name == "factorised") return make_factorised();
  std::string known;
  for (const auto& one : model_names) known += (known.empty() ? "" : ", ") + one;
  throw Error(ExitCode::usage, "model \"" + name + "\": expected one of " + known);
}

namespace {

// "512-256" -> 512, 256; empty if it is no such list.
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

// What did best on validation records at the base condition. 512-256 is the paper's network.
FitOptions own_options(const std::string& model) {
  FitOptions own;
  if (model == "mlp" || model == "pca-mlp") {
    own.hidden = {512, 256};
    own.epochs = 60, own.patience = 15, own.learning_rate = 2e-3, own.weight_decay = 0.7;
  }
  if (model == "silhouette" || model == "factorised") {
    own.basis = 16;
    own.epochs = 100, own.patience = 100, own.learning_rate = 3e-3, own.weight_decay = 0.3;
  }
  if (model == "pca-mlp") own.basis = 128;
  if (model == "nearest") own.basis = 1;
  return own;
}

template <class T>
void fill(std::optional<T>& option, const std::optional<T>& own) {
  if (!option) option = own;
}

}  // namespace

Candidate candidate_of(const std::string& name, const FitOptions& base) {
  Candidate out{name, name, base};
  const auto digit = name.find_first_of("0123456789");
  const bool sized = digit != std::string::npos && digit > 1 && name[digit - 1] == '-';
  if (sized) out.model = name.substr(0, digit - 1);
  make_model(out.model);  // says what is known
  const FitOptions own = own_options(out.model);
  fill(out.fit.hidden, own.hidden), fill(out.fit.basis, own.basis);
  fill(out.fit.epochs, own.epochs), fill(out.fit.patience, own.patience);
  fill(out.fit.learning_rate, own.learning_rate), fill(out.fit.weight_decay, own.weight_decay);
  if (!sized) return out;
  const auto numbers =
      name.back() == '-' ? std::vector<std::size_t>{} : numbers_of(name.substr(digit));
  const bool network = out.model == "mlp" || out.model == "pca-mlp";
  const bool basis = out.model == "factorised" || out.model == "nearest";
  if (numbers.empty() || !(network || (basis && numbers.size() == 1 && numbers[0] <= 1024)))
    throw Error(ExitCode::usage,
                "model \"" + name + "\": sizes follow as in mlp-512-256 or factorised-16");
  if (network ? base.hidden.has_value() : base.basis.has_value())
    throw Error(ExitCode::usage, "model \"" + name + "\": its size is given once more by " +
                                     (network ? "--hidden" : "--basis"));
  if (network)
    out.fit.hidden = numbers;
  else
    out.fit.basis = numbers.front();
  return out;
}

bool ignores_inputs(const std::string& name) { return name == "empty" || name == "mean"; }

bool wants_alignment(const std::string& name) {
  return name == "silhouette" || name == "factorised";
}

}  // namespace echofuse::recon
