// SPDX-License-Identifier: MIT
#include "drivers/tdc/usb_tdc.hpp"

#include <optional>
#include <utility>

#include "drivers/port/raw_tap.hpp"
#include "drivers/port/worker_link.hpp"
#include "drivers/tdc/usb_link.hpp"

namespace echofuse::tdc {
namespace {

using namespace std::chrono_literals;

constexpr auto serve_limit = 50ms;
constexpr auto status_pause = 1s;
// A device ends a transfer every 100 ms, be it empty.
constexpr auto silence_limit = 3s;
static_assert(UsbTdc::ring_bytes == usb::Link::transfer_count * usb::Link::transfer_bytes);
constexpr std::size_t max_queued_tags = (64u << 20) / sizeof(Tag);

std::string version_of(std::uint16_t bcd) {
  char text[16];
  std::snprintf(text, sizeof text, "%x.%02x", bcd >> 8, bcd & 0xffu);
  return text;
}

}  // namespace

struct UsbTdc::Shared : port::WorkerLink {
  using WorkerLink::WorkerLink;
  std::atomic<std::size_t> queued_tags{0};
  std::mutex mutex;  // of the counters below, which the worker's thread sets as a whole
  usb::RecordCounts records;
  usb::LinkCounts transfers;
  std::uint64_t dropped_tags = 0, device_lost = 0, connections = 0;
};

// The device's thread.
class UsbTdc::Worker {
 public:
  Worker(std::shared_ptr<Shared> shared, DeviceInfo info, port::UsbAddress usb, const Clock& clock,
         port::RawKeeper* raw)
      : shared_(std::move(shared)),
        info_(std::move(info)),
        usb_(std::move(usb)),
        clock_(clock),
        raw_(raw) {}

  void run() {
    shared_->run(info_, backoff_, [this] {
      const std::string why = run_session();
      publish();
      return why;
    });
  }

 private:
  // Until the device fails: why.
  std::string run_session() {
    if (std::exchange(had_session_, false)) interrupt();  // what waits for its end waits in vain
    usb::Link link(transfers_);
    std::string wrong = link.open(
        usb_, [this](ByteView bytes, bool ends) { on_transfer(bytes, ends); },
        [this] { interrupt(); });
    if (!wrong.empty()) return wrong;
    ++connections_;
    had_session_ = true;
    describe(link);
    shared_->report(info_, DeviceState::streaming);
    lost_before_ = device_lost_;  // a device counts from its start
    last_heartbeat_ = clock_.now();
    HostTime next_status = last_heartbeat_ + status_pause;
    while (wrong.empty() && !shared_->stopping()) {
      wrong = link.serve(serve_limit);
      const HostTime now = clock_.now();
      if (wrong.empty() && now - last_heartbeat_ > silence_limit)
        wrong = "the device sent neither tags nor empty runs for 3 s";
      if (now < next_status) continue;
      next_status = now + status_pause;
      if (const auto status = link.status()) device_lost_ = lost_before_ + status->lost;
      publish();
    }
    return wrong;
  }

  void describe(usb::Link& link) {
    const libusb_device_descriptor& d = link.descriptor();
    info_.model = link.text(d.iManufacturer) + " " + link.text(d.iProduct);
    info_.serial = link.text(d.iSerialNumber);
    info_.firmware = version_of(d.bcdDevice);
  }

  void interrupt() {
    keep({}, usb::kept_gap);
    records_.interrupt();
  }

  void keep(ByteView bytes, std::uint32_t flags) {
    if (!raw_) return;
    if (raw_name_.empty()) raw_name_ = raw_->next_name("tags", ".usb");
    Bytes piece;
    put(piece, static_cast<std::uint32_t>(bytes.size()) | flags);
    piece.insert(piece.end(), bytes.begin(), bytes.end());
    raw_->put(raw_name_, piece);
  }

  void on_transfer(ByteView bytes, bool ends) {
    const HostTime now = clock_.now();
    keep(bytes, ends ? usb::kept_end : 0);
    std::vector<Tag> tags;
    const bool gap = records_.feed(bytes, ends, tags);
    // Junk is no heartbeat.
    if (bytes.empty() || !tags.empty()) last_heartbeat_ = now;
    if (tags.empty()) return;
    backoff_.alive(last_heartbeat_);
    if (shared_->queued_tags + tags.size() > max_queued_tags) {
      dropped_tags_ += tags.size();
      dropped_since_ += tags.size();
      gap_since_ = gap_since_ || gap;
      return;
    }
    hand_over(std::move(tags), std::exchange(gap_since_, false) || gap);
  }

  void hand_over(std::vector<Tag> tags, bool gap) {
    shared_->queued_tags += tags.size();
    shared_->post([shared = shared_, received = last_heartbeat_, tags = std::move(tags), gap,
                   dropped = std::exchange(dropped_since_, 0)](SampleSink& sink) {
      shared->queued_tags -= tags.size();
      sink.on_tags({.received = received,
                    .tags = tags,
                    .lost_blocks = gap ? 1u : 0u,
                    .lost_items = dropped});
    });
  }

  void publish() {
    const std::lock_guard lock(shared_->mutex);
    shared_->records = records_.counts();
    shared_->transfers = transfers_;
    shared_->dropped_tags = dropped_tags_;
    shared_->device_lost = device_lost_;
    shared_->connections = connections_;
  }

  std::shared_ptr<Shared> shared_;
  DeviceInfo info_;
  port::UsbAddress usb_;
  const Clock& clock_;
  port::RawKeeper* raw_;
  std::string raw_name_;  // one file: its gaps are marked
  port::Backoff backoff_;
  usb::RecordReader records_;
  usb::LinkCounts transfers_;
  HostTime last_heartbeat_{};
  bool had_session_ = false;
  bool gap_since_ = false;           // not yet handed on
  std::uint64_t dropped_since_ = 0;  // the same
  std::uint64_t dropped_tags_ = 0, device_lost_ = 0, connections_ = 0;
  std::uint64_t lost_before_ = 0;  // by the device in former sessions
};

UsbTdc::UsbTdc(boost::asio::io_context& io, std::string address, port::UsbAddress usb,
               const Clock& clock, port::RawKeeper* raw)
    : shared_(std::make_shared<Shared>(io)),
      address_(std::move(address)),
      usb_(std::move(usb)),
      clock_(clock),
      raw_(raw) {}

UsbTdc::~UsbTdc() { shared_->join(); }

void UsbTdc::start(SampleSink& sink) {
  DeviceInfo info;
  info.sensor = Sensor::spd;
  info.address = address_;
  const auto worker = std::make_shared<Worker>(shared_, info, usb_, clock_, raw_);
  shared_->start(sink, info, [worker] { worker->run(); });
}

void UsbTdc::stop() { shared_->stop(); }

bool UsbTdc::finished() const { return shared_->finished(); }

std::vector<Counter> UsbTdc::counters() const {
  const std::lock_guard lock(shared_->mutex);
  const Shared& s = *shared_;
  return {{"bytes", s.transfers.bytes},
          {"transfers", s.transfers.transfers},
          {"tags", s.records.tags},
          {"junk_bytes", s.records.junk_bytes},
          {"gaps", s.records.gaps},
          {"stalls", s.transfers.stalls},
          {"transfer_errors", s.transfers.transfer_errors},
          {"lost_items", s.dropped_tags},
          {"device_lost", s.device_lost},
          {"connections", s.connections}};
}

}  // namespace echofuse::tdc
