// SPDX-License-Identifier: MIT
// Options that several sub-commands have.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/job_part.hpp"
#include "recon/models/model.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

void add_inputs_option(CLI::App& app, std::string& inputs);
// --part; read it with part_of, which throws Error(usage). None if it is not given.
std::shared_ptr<std::string> add_part_option(CLI::App& app);
std::optional<JobPart> part_of(const std::string& text);
// For CLI11: empty if the text names a model, else what is wrong.
std::string is_candidate(const std::string& text);

}  // namespace echofuse::recon
