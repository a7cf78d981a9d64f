// SPDX-License-Identifier: MIT
// Several sub-commands have these options.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "drivers/program/job_part.hpp"
#include "recon/models/model.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

void add_inputs_option(CLI::App& app, std::string& inputs);
// The option is --part; part_of reads it, and throws Error(usage). The value is null if it is not
// given.
std::shared_ptr<std::string> add_part_option(CLI::App& app);
std::optional<JobPart> part_of(const std::string& text);
// For CLI11 the answer is empty if the text names a model, else it says what is wrong.
std::string is_candidate(const std::string& text);

}  // namespace echofuse::recon
