// SPDX-License-Identifier: MIT
#pragma once
#include <string_view>

namespace echofuse::recon {

// recon/page/report.html with styles and scripts in it; {{data}} is left.
std::string_view page_shell();

}  // namespace echofuse::recon
