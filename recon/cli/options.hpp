// SPDX-License-Identifier: MIT
// Options that several sub-commands have.
#pragma once
#include <string>

#include "recon/models/model.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

void add_inputs_option(CLI::App& app, std::string& inputs);
void add_fit_options(CLI::App& app, std::string& scaling, FitOptions& fit);
// For CLI11: empty if the text names a model, else what is wrong.
std::string is_candidate(const std::string& text);

}  // namespace echofuse::recon
