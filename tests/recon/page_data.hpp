// SPDX-License-Identifier: MIT
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "world.hpp"

namespace echofuse::testing {

// What a page says and shows (recon/page/page.hpp).
inline nlohmann::json page_data(const std::string& path) {
  const std::string html = contents(path), begin = "id=\"data\">";
  const std::size_t at = html.find(begin) + begin.size();
  return nlohmann::json::parse(html.substr(at, html.find("</script>", at) - at));
}

}  // namespace echofuse::testing
