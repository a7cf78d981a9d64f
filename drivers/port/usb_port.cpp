// SPDX-License-Identifier: MIT
#include <libusb.h>

#include <algorithm>
#include <array>

#include "drivers/port/open_port.hpp"
#include "drivers/port/thread_port.hpp"

namespace echofuse::port {
namespace {

constexpr std::size_t transfer_count = 8, transfer_bytes = usb_ring_bytes / transfer_count;
constexpr std::size_t max_queued = 64u << 20;
constexpr unsigned request_limit_ms = 500;
constexpr auto cancel_limit = std::chrono::seconds(2);
// maximum time in ms for which the device remains in use after its port is closed
constexpr int turn_ms = 10;

struct UsbLink : ThreadLink {
  using ThreadLink::ThreadLink;
  // number of bytes posted to the loop's thread but not yet delivered
  std::atomic<std::size_t> queued{0};
};

// Opens and uses the device on the port's own thread.
class UsbWorker {
 public:
  UsbWorker(std::shared_ptr<UsbLink> link, std::string name, UsbAddress address)
      : link_(std::move(link)), name_(std::move(name)), address_(std::move(address)) {}
  ~UsbWorker() {
    stopping_ = true;
    cancel();
    if (started_) request(usb_stop);
    if (any_busy()) {  // leaks the buffers, because libusb may still write into them
      for (Transfer& slot : slots_) new Bytes(std::move(slot.buffer));
      static_cast<void>(handle_.release());
      static_cast<void>(context_.release());
      return;
    }
    for (Transfer& slot : slots_) libusb_free_transfer(slot.transfer);
    if (claimed_) libusb_release_interface(handle_.get(), interface_);
  }
  UsbWorker(const UsbWorker&) = delete;
  UsbWorker& operator=(const UsbWorker&) = delete;

  std::optional<Failure> serve() {
    if (!open() || !start()) return failure_;
    post_opened(link_);
    while (!link_->stopping) {
      timeval time{.tv_sec = 0, .tv_usec = turn_ms * 1000};
      libusb_handle_events_timeout_completed(context_.get(), &time, nullptr);
      if (!failure_) submit_idle();
      if (failure_) return failure_;
    }
    return std::nullopt;
  }

 private:
  struct Context {
    void operator()(libusb_context* c) const { libusb_exit(c); }
  };
  struct Handle {
    void operator()(libusb_device_handle* h) const { libusb_close(h); }
  };
  struct Transfer {
    UsbWorker* worker = nullptr;
    libusb_transfer* transfer = nullptr;
    Bytes buffer;
    bool busy = false;
  };

  // Stores the failure unless an earlier one has been stored. Always returns false.
  bool fail(std::errc code, const std::string& why) {
    if (!failure_) failure_ = failure(code, name_ + ": " + why);
    return false;
  }
  bool fail(const std::string& doing, int error) {
    struct Cause {
      int error;
      std::errc code;
      const char* hint;
    };
    constexpr Cause causes[] = {
        {LIBUSB_ERROR_ACCESS, std::errc::permission_denied,
         " (install config/70-echofuse.rules and join the group plugdev)"},
        {LIBUSB_ERROR_BUSY, std::errc::device_or_resource_busy, " (in use by another program)"},
        {LIBUSB_ERROR_NO_MEM, std::errc::not_enough_memory,
         " (raise /sys/module/usbcore/parameters/usbfs_memory_mb, shared by all USB programs)"},
        {LIBUSB_ERROR_NO_DEVICE, std::errc::no_such_device, ""}};
    for (const Cause& cause : causes)
      if (cause.error == error) return fail(cause.code, doing + cause.hint);
    return fail(std::errc::io_error, doing + " (" + libusb_strerror(error) + ")");
  }

  bool open() {
    libusb_context* context = nullptr;
    if (const int error = libusb_init(&context)) return fail("cannot start libusb", error);
    context_.reset(context);
    libusb_device** list = nullptr;
    const auto count = libusb_get_device_list(context_.get(), &list);
    if (count < 0) return fail("cannot list USB devices", static_cast<int>(count));
    std::string serials, others;
    libusb_device* only = nullptr;
    int fitting = 0;
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      libusb_device_descriptor d{};
      if (libusb_get_device_descriptor(list[i], &d) != 0 || d.idVendor != address_.vendor ||
          d.idProduct != address_.product || !open_device(list[i]))
        continue;
      const std::string serial = text(d.iSerialNumber);
      const bool fits = address_.serial.empty() || serial == address_.serial;
      std::string& names = fits ? serials : others;
      names += (names.empty() ? "" : ", ") + serial;
      if (fits && fitting++ == 0) only = list[i];
    }
    handle_.reset();
    bool found = false;
    if (fitting > 1)
      fail(std::errc::device_or_resource_busy, "the address matches several devices (attached: " +
                                                   serials + "): append the serial number");
    else if (fitting == 0)
      fail(std::errc::no_such_device,
           others.empty() ? "cannot open" : "cannot open; only " + others + " is attached");
    else
      found = open_device(only) && find_interface(only);
    libusb_free_device_list(list, 1);
    // discards the failures to open other devices
    if (found) failure_.reset();
    return found;
  }

  bool open_device(libusb_device* device) {
    libusb_device_handle* handle = nullptr;
    const int error = libusb_open(device, &handle);
    handle_.reset(handle);
    return error == 0 || fail("cannot open", error);
  }

  std::string text(std::uint8_t index) {
    std::array<unsigned char, 128> buffer{};
    const int got = index == 0 ? 0
                               : libusb_get_string_descriptor_ascii(handle_.get(), index,
                                                                    buffer.data(), buffer.size());
    return got > 0 ? std::string(buffer.begin(), buffer.begin() + got) : "";
  }

  bool find_interface(libusb_device* device) {
    libusb_config_descriptor* config = nullptr;
    if (const int error = libusb_get_active_config_descriptor(device, &config))
      return fail("cannot read the USB descriptors", error);
    bool found = false;
    for (int i = 0; i < config->bNumInterfaces && !found; ++i) {
      const libusb_interface& interface = config->interface[i];
      if (interface.num_altsetting == 0) continue;
      const libusb_interface_descriptor& d = interface.altsetting[0];
      if (d.bInterfaceClass != usb_class || d.bInterfaceSubClass != usb_subclass ||
          d.bInterfaceProtocol != usb_protocol)
        continue;
      for (int e = 0; e < d.bNumEndpoints && !found; ++e) {
        const libusb_endpoint_descriptor& endpoint = d.endpoint[e];
        const bool bulk = (endpoint.bmAttributes & 3) == LIBUSB_TRANSFER_TYPE_BULK;
        found = bulk && (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN);
        interface_ = d.bInterfaceNumber;
        endpoint_ = endpoint.bEndpointAddress;
      }
    }
    libusb_free_config_descriptor(config);
    return found || fail(std::errc::no_such_device,
                         "the device has no interface for blocks (expected class ff, subclass 45, "
                         "protocol 01)");
  }

  // Starts the stream. A previous program may have left the interface halted or running. Requests
  // data only after the device has responded to the start request, because the device first
  // discards previously buffered data.
  bool start() {
    if (const int error = libusb_claim_interface(handle_.get(), interface_))
      return fail("claim", error);
    claimed_ = true;
    libusb_clear_halt(handle_.get(), endpoint_);
    if (const int error = request(usb_start); error < 0) return fail("start", error);
    started_ = true;
    for (Transfer& slot : slots_) {
      slot.worker = this;
      slot.buffer.resize(transfer_bytes);
      slot.transfer = libusb_alloc_transfer(0);
    }
    submit_idle();
    return !failure_;
  }

  int request(std::uint8_t what) {
    return libusb_control_transfer(handle_.get(), usb_vendor_out, what, 0,
                                   static_cast<std::uint16_t>(interface_), nullptr, 0,
                                   request_limit_ms);
  }

  void submit_idle() {
    for (Transfer& slot : slots_) {
      if (slot.busy || failure_ || stopping_ || link_->queued > max_queued) continue;
      libusb_fill_bulk_transfer(slot.transfer, handle_.get(), endpoint_, slot.buffer.data(),
                                static_cast<int>(slot.buffer.size()), completed, &slot, 0);
      const int error = libusb_submit_transfer(slot.transfer);
      slot.busy = error == 0;
      if (error != 0) fail("cannot queue a transfer", error);
    }
  }

  static void LIBUSB_CALL completed(libusb_transfer* transfer) {
    Transfer& slot = *static_cast<Transfer*>(transfer->user_data);
    slot.busy = false;
    slot.worker->on_completed(slot);
  }

  // Delivers the transfer's bytes regardless of its status, because the device sent them before it
  // stalled or disconnected. After a disconnection, libusb completes the transfers in any order,
  // and any of them may contain data.
  void on_completed(const Transfer& slot) {
    const libusb_transfer& t = *slot.transfer;
    const bool in_order = !failure_ || t.status == LIBUSB_TRANSFER_NO_DEVICE;
    if (t.actual_length > 0 && !stopping_ && in_order)
      hand_over({slot.buffer.begin(), slot.buffer.begin() + t.actual_length});
    if (t.status == LIBUSB_TRANSFER_COMPLETED || t.status == LIBUSB_TRANSFER_CANCELLED)
      return submit_idle();
    if (t.status == LIBUSB_TRANSFER_NO_DEVICE)
      fail(std::errc::no_such_device, "read");
    else if (t.status == LIBUSB_TRANSFER_STALL)
      fail(std::errc::broken_pipe, "endpoint halted");
    else
      fail(std::errc::io_error, "USB transfer failed");
  }

  void hand_over(Bytes bytes) {
    link_->queued += bytes.size();
    post(link_, [bytes = std::move(bytes)](UsbLink& link) {
      link.queued -= bytes.size();
      link.handlers.bytes(bytes);
    });
  }

  bool any_busy() const {
    return std::any_of(slots_.begin(), slots_.end(), [](const Transfer& s) { return s.busy; });
  }

  void cancel() {
    for (Transfer& slot : slots_)
      if (slot.busy) libusb_cancel_transfer(slot.transfer);
    const auto give_up = std::chrono::steady_clock::now() + cancel_limit;
    while (any_busy() && std::chrono::steady_clock::now() < give_up) {
      timeval time{.tv_sec = 0, .tv_usec = turn_ms * 1000};
      libusb_handle_events_timeout_completed(context_.get(), &time, nullptr);
    }
  }

  std::shared_ptr<UsbLink> link_;
  std::string name_;
  UsbAddress address_;
  std::unique_ptr<libusb_context, Context> context_;
  std::unique_ptr<libusb_device_handle, Handle> handle_;
  std::array<Transfer, transfer_count> slots_;
  std::optional<Failure> failure_;
  int interface_ = 0;
  std::uint8_t endpoint_ = 0;
  bool claimed_ = false, started_ = false, stopping_ = false;
};

class UsbPort final : public ThreadPort<UsbLink, UsbWorker> {
 public:
  using ThreadPort::ThreadPort;
  void write(ByteView) override {}
};

}  // namespace

std::unique_ptr<BytePort> make_usb_port(boost::asio::io_context& io, const std::string& name,
                                        const UsbAddress& address) {
  return std::make_unique<UsbPort>(io, name, address);
}

}  // namespace echofuse::port
