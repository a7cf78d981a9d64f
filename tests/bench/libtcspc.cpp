// SPDX-License-Identifier: MIT
#include "libtcspc.hpp"

#include <array>
#include <libtcspc/arg_wrappers.hpp>
#include <libtcspc/batch_unbatch.hpp>
#include <libtcspc/binning.hpp>
#include <libtcspc/bucket.hpp>
#include <libtcspc/histogram.hpp>
#include <libtcspc/pair.hpp>
#include <libtcspc/select.hpp>
#include <libtcspc/swabian_tag.hpp>
#include <libtcspc/time_correlate.hpp>
#include <type_traits>

namespace echofuse::bench {
namespace {

struct Numbers : tcspc::default_numeric_traits {
  using difftime_type = std::int64_t;
  using datapoint_type = std::int64_t;
  using bin_index_type = std::uint32_t;
  using bin_type = std::uint32_t;
};
using Counts = tcspc::concluding_histogram_event<Numbers>;
struct End {};

struct Sink {
  std::vector<std::uint32_t>* counts;

  template <class Event>
  void handle(Event&& event) {
    if constexpr (std::is_same_v<std::remove_cvref_t<Event>, Counts>)
      counts->assign(event.data_bucket.begin(), event.data_bucket.end());
  }
  void flush() {}
  auto introspect_node() const -> tcspc::processor_info {
    return tcspc::processor_info(this, "Sink");
  }
  auto introspect_graph() const -> tcspc::processor_graph {
    return tcspc::processor_graph().push_entry_point(this);
  }
};

}  // namespace

std::vector<std::uint32_t> libtcspc_histogram(std::span<const Tag> tags,
                                              const tdc::HistogramSettings& settings) {
  using namespace tcspc;
  using Pair = std::array<detection_event<Numbers>, 2>;
  constexpr auto policy =
      histogram_policy::error_on_overflow | histogram_policy::emit_concluding_events;
  std::vector<std::uint32_t> counts;
  auto bins = tcspc::histogram<policy, End, Numbers>(
      arg::num_bins<std::size_t>(settings.bins), arg::max_per_bin<std::uint32_t>(UINT32_MAX),
      new_delete_bucket_source<std::uint32_t>::create(), select<type_list<Counts>>(Sink{&counts}));
  auto binned = map_to_bins<Numbers>(
      linear_bin_mapper<Numbers>(arg::offset<std::int64_t>(settings.first_bin_ps),
                                 arg::bin_width<std::int64_t>(settings.bin_width_ps),
                                 arg::max_bin_index<std::uint32_t>(settings.bins - 1)),
      std::move(bins));
  auto differences = time_correlate_at_stop<Numbers>(
      map_to_datapoints<time_correlated_detection_event<Numbers>, Numbers>(
          difftime_data_mapper<Numbers>(), std::move(binned)));
  auto pairs =
      pair_all<1, Numbers>(arg::start_channel<std::int32_t>(1), {2},
                           arg::time_window<std::int64_t>(
                               settings.first_bin_ps + settings.bin_width_ps * settings.bins - 1),
                           select<type_list<Pair, End>>(std::move(differences)));
  auto input =
      unbatch<std::span<const swabian_tag_event>>(decode_swabian_tags<Numbers>(std::move(pairs)));
  input.handle(std::span(reinterpret_cast<const swabian_tag_event*>(tags.data()), tags.size()));
  input.handle(End{});
  input.flush();
  return counts;
}

}  // namespace echofuse::bench
