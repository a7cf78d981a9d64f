// SPDX-License-Identifier: MIT
#include "drivers/tdc/tag_groups.hpp"

// Highway compiles this kernel for all instruction sets except the one that the build itself
// targets. The include below adds that one.
#define HWY_TARGET_INCLUDE "drivers/tdc/tag_groups_kernel.hpp"
#include <hwy/foreach_target.h>

#include "drivers/tdc/tag_groups_kernel.hpp"

namespace echofuse::tdc {

HWY_EXPORT(take_groups);
HWY_EXPORT(has_only_ordered_times);

std::size_t count_groups(const Tag* tags, std::size_t count, const ClickBins& bins, TagRun& run,
                         std::uint32_t* cells) {
  return HWY_DYNAMIC_DISPATCH(take_groups)(tags, count, bins, run, cells);
}

bool only_ordered_times(std::span<const Tag> tags, std::uint64_t before_ps) {
  return tags.empty() ||
         HWY_DYNAMIC_DISPATCH(has_only_ordered_times)(tags.data(), tags.size(), before_ps);
}

}  // namespace echofuse::tdc
