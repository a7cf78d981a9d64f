// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <hidapi/hidapi.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <string>
#include <utility>

#include "drivers/port/cp2110.hpp"
#include "drivers/port/open_port.hpp"
#include "drivers/port/thread_port.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::port {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr auto status_period = std::chrono::seconds(1);
// timeout of a read; queued output may be delayed by up to this time
constexpr int read_wait_ms = 2;
// maximum size of each queue in bytes; equals 4 s of data at the maximum rate
constexpr std::size_t max_waiting = 256 << 10;

// Several processes can read a hidraw node. A lock on the node excludes other echofuse programs.
struct CloseDevice {
  int lock = -1;
  void operator()(hid_device* device) const {
    hid_close(device);
    ::close(lock);
  }
};
using HidDevice = std::unique_ptr<hid_device, CloseDevice>;

std::string name_of(const HidAddress& address) {
  return format("hid:%04x:%04x", unsigned{address.vendor}, unsigned{address.product}) +
         (address.serial.empty() ? "" : ':' + address.serial);
}

std::string narrow(const wchar_t* text) {
  std::string out;
  for (; text && *text; ++text) out += *text > 0 && *text < 128 ? static_cast<char>(*text) : '?';
  return out;
}

// Returns the path of the /dev/hidraw node if exactly one device matches.
Result<std::string> find_node(const HidAddress& address) {
  hid_device_info* list = hid_enumerate(address.vendor, address.product);
  std::string node, others;
  int fitting = 0;
  for (const auto* d = list; d; d = d->next) {
    const std::string serial = narrow(d->serial_number);
    if (address.serial.empty() || serial == address.serial) {
      node = d->path;
      ++fitting;
    }
    others += (others.empty() ? " (attached: " : ", ") + serial;
  }
  hid_free_enumeration(list);
  if (fitting == 1) return node;
  if (fitting > 1)
    return failure(std::errc::device_or_resource_busy,
                   name_of(address) + ": cannot open; the address matches several devices" +
                       others + "): append the serial number");
  if (!others.empty()) others += ')';
  return failure(std::errc::no_such_device, name_of(address) + ": cannot open" + others);
}

Result<HidDevice> open_device(const HidAddress& address) {
  static std::mutex hidapi_globals;
  const std::lock_guard lock(hidapi_globals);
  const Result<std::string> node = find_node(address);
  if (!node) return node.failure();
  const std::string doing = name_of(address) + ": cannot open " + *node;
  const int fd = ::open(node->c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  int error = fd < 0 ? errno : 0;
  if (error == 0 && ::flock(fd, LOCK_EX | LOCK_NB) != 0)
    error = errno == EWOULDBLOCK ? EBUSY : errno;
  if (error == 0) {
    if (hid_device* device = hid_open_path(node->c_str()))
      return HidDevice(device, CloseDevice{fd});
    error = EIO;  // hidapi does not report the cause of the failure
  }
  if (fd >= 0) ::close(fd);
  return Failure{{error, std::generic_category()},
                 doing + (error == EACCES  ? " (" + permission_hint(*node) + ")"
                          : error == EBUSY ? " (in use by another program)"
                                           : "")};
}

struct HidLink : ThreadLink {
  using ThreadLink::ThreadLink;
  std::mutex mutex;  // protects the members below
  Bytes in, out;
  bool posted = false;
  std::uint64_t dropped = 0;  // number of bytes dropped in both directions since the last report
};
using HidLinkPtr = std::shared_ptr<HidLink>;

void append(HidLink& link, Bytes& queue, ByteView bytes) {
  const std::size_t fits = std::min(bytes.size(), max_waiting - queue.size());
  queue.insert(queue.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(fits));
  link.dropped += bytes.size() - fits;
}

void deliver(HidLink& link) {
  Bytes bytes;
  {
    const std::lock_guard lock(link.mutex);
    bytes.swap(link.in);
    link.posted = false;
  }
  link.handlers.bytes(bytes);
}

// Opens and uses the device on the port's own thread.
class HidWorker {
 public:
  HidWorker(HidLinkPtr link, HidAddress address, std::uint32_t baud)
      : link_(std::move(link)), address_(std::move(address)), baud_(baud) {}

  // Runs until the port is closed or the device fails. Returns nullopt if the port was closed,
  // otherwise the failure.
  std::optional<Failure> serve() {
    Result<HidDevice> opened = open_device(address_);
    if (!opened) return opened.failure();
    device_ = std::move(*opened);
    if (!send_feature(cp2110::config_report(baud_)) || !send_feature(cp2110::enable_report) ||
        !send_feature(cp2110::purge_report))
      return failed("cannot configure the bridge (is it a CP2110?)");
    discard();
    post_opened(link_);
    if (baud_ / 10 > cp2110::pipe_bytes_per_s)
      warn(std::to_string(baud_) + " baud delivers up to " + std::to_string(baud_ / 10) +
               " bytes/s, but USB carries at most 63000 bytes/s: use shorter frames or a lower "
               "baud rate",
           0);
    auto next_status = SteadyClock::now() + status_period;
    while (!link_->stopping) {
      const char* wrong = !receive() ? "read" : !send() ? "write" : nullptr;
      if (wrong || SteadyClock::now() >= next_status) report_dropped();
      if (wrong) return failed(wrong);
      if (SteadyClock::now() < next_status) continue;
      next_status += status_period;
      check();
    }
    return std::nullopt;
  }

 private:
  // Discards reports that arrived before the buffers were purged. The kernel buffers up to 64
  // reports.
  void discard() {
    std::array<std::uint8_t, cp2110::report_bytes> report;
    for (int i = 0; i < 64; ++i)
      if (hid_read_timeout(device_.get(), report.data(), report.size(), 0) <= 0) return;
  }

  Failure failed(const char* doing) const {
    return failure(std::errc::no_such_device, name_of(address_) + ": " + doing);
  }

  template <std::size_t N>
  bool send_feature(const std::array<std::uint8_t, N>& report) {
    return hid_send_feature_report(device_.get(), report.data(), N) >= 0;
  }

  void warn(const std::string& text, std::uint64_t losses) {
    post(link_, [text = name_of(address_) + ": " + text, losses](HidLink& link) {
      if (link.handlers.warning) link.handlers.warning(text, losses);
    });
  }

  bool receive() {
    std::array<std::uint8_t, cp2110::report_bytes> report;
    const int n = hid_read_timeout(device_.get(), report.data(), report.size(), read_wait_ms);
    if (n < 0) return false;
    const ByteView data = cp2110::data_of(ByteView(report).first(static_cast<std::size_t>(n)));
    if (data.empty()) return true;
    const std::lock_guard lock(link_->mutex);
    append(*link_, link_->in, data);
    if (!std::exchange(link_->posted, true)) post(link_, deliver);
    return true;
  }

  bool send() {
    Bytes bytes;
    {
      const std::lock_guard lock(link_->mutex);
      bytes.swap(link_->out);
    }
    for (ByteView rest = bytes; !rest.empty() && !link_->stopping;) {
      const auto report = cp2110::next_data_report(rest);
      if (hid_write(device_.get(), report.data(), report.size()) < 0) return false;
    }
    return true;
  }

  // Polls the UART status. A failed request causes only a warning, because a disconnected bridge is
  // detected by read().
  void check() {
    std::array<std::uint8_t, cp2110::status_bytes> report{cp2110::status_id};
    const int n = hid_get_feature_report(device_.get(), report.data(), report.size());
    const auto size = static_cast<std::size_t>(std::max(n, 0));
    const auto status = cp2110::parse_status(ByteView(report).first(std::min(size, report.size())));
    if (!status)
      return warn("the bridge does not report its status; UART overruns are not detected", 0);
    if (status->overrun) warn("overrun: the bridge lost bytes", 1);
    if (status->parity_error) warn("parity errors: the bridge received damaged bytes", 1);
  }

  void report_dropped() {
    std::uint64_t dropped = 0;
    {
      const std::lock_guard lock(link_->mutex);
      std::swap(dropped, link_->dropped);
    }
    if (dropped > 0) warn("bytes dropped because the program did not read them in time", dropped);
  }

  HidLinkPtr link_;
  HidAddress address_;
  std::uint32_t baud_;
  HidDevice device_;
};

class HidPort final : public ThreadPort<HidLink, HidWorker> {
 public:
  using ThreadPort::ThreadPort;
  void write(ByteView bytes) override {
    if (!link_->open) return;
    const std::lock_guard lock(link_->mutex);
    append(*link_, link_->out, bytes);
  }
};

}  // namespace

void check_hid_baud(const HidAddress& address, std::uint32_t baud) {
  if (baud < cp2110::min_baud || baud > cp2110::max_baud)
    throw Error(ExitCode::config, name_of(address) + ": " + std::to_string(baud) +
                                      " baud (a CP2110 supports 300 to 1000000 baud)");
}

std::unique_ptr<BytePort> make_hid_port(boost::asio::io_context& io, const HidAddress& address,
                                        std::uint32_t baud) {
  return std::make_unique<HidPort>(io, address, baud);
}

}  // namespace echofuse::port
