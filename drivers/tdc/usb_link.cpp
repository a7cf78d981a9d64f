// SPDX-License-Identifier: MIT
#include "drivers/tdc/usb_link.hpp"

#include <algorithm>
#include <utility>

namespace echofuse::tdc::usb {
namespace {

constexpr unsigned request_limit_ms = 500;
constexpr auto cancel_limit = std::chrono::seconds(2);
constexpr int max_errors_in_a_row = 10;

std::string reason(const char* doing, int error) {
  std::string text = std::string(doing) + ": " + libusb_strerror(error);
  if (error == LIBUSB_ERROR_ACCESS) text += " (see config/70-echofuse.rules)";
  if (error == LIBUSB_ERROR_BUSY) text += " (another program uses it)";
  if (error == LIBUSB_ERROR_NO_MEM)
    text += " (raise /sys/module/usbcore/parameters/usbfs_memory_mb, shared by all USB programs)";
  return text;
}

}  // namespace

Link::Link(LinkCounts& counts) : counts_(counts) {}

Link::~Link() {
  stopping_ = true;
  cancel();
  if (started_ && !gone_) {
    Bytes nothing;
    request(Request::stop, nothing);
  }
  if (any_busy()) {  // libusb still writes into them: better lost than freed
    for (Slot& slot : slots_) new Bytes(std::move(slot.buffer));
    static_cast<void>(handle_.release());
    static_cast<void>(context_.release());
    return;
  }
  for (Slot& slot : slots_) libusb_free_transfer(slot.transfer);
  if (claimed_ && !gone_) libusb_release_interface(handle_.get(), interface_);
}

std::string Link::open(const port::UsbAddress& address, OnTransfer on_transfer, OnGap on_gap) {
  on_transfer_ = std::move(on_transfer);
  on_gap_ = std::move(on_gap);
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context)) return reason("start libusb", error);
  context_.reset(context);
  std::string wrong = find(address);
  if (wrong.empty()) wrong = start();
  return wrong;
}

std::string Link::find(const port::UsbAddress& address) {
  libusb_device** list = nullptr;
  const auto count = libusb_get_device_list(context_.get(), &list);
  if (count < 0) return reason("list devices", static_cast<int>(count));
  std::string wrong = "no such device is attached", serials;
  libusb_device* only = nullptr;
  int fitting = 0;
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    if (try_device(list[i], address, wrong)) {
      only = list[i];
      serials += (fitting++ > 0 ? ", " : "") + text(descriptor_.iSerialNumber);
    }
    handle_.reset();
  }
  if (fitting > 1)
    wrong =
        "the address fits several (attached: " + serials + "): give the serial number behind it";
  if (fitting != 1 || !try_device(only, address, wrong)) handle_.reset();
  libusb_free_device_list(list, 1);
  return handle_ ? "" : wrong;
}

// True: it is the one, and open. Else `wrong` says why, if it came close.
bool Link::try_device(libusb_device* device, const port::UsbAddress& address, std::string& wrong) {
  if (libusb_get_device_descriptor(device, &descriptor_) != 0) return false;
  if (descriptor_.idVendor != address.vendor || descriptor_.idProduct != address.product)
    return false;
  libusb_device_handle* handle = nullptr;
  if (const int error = libusb_open(device, &handle)) {
    wrong = reason("open", error);
    return false;
  }
  handle_.reset(handle);
  const std::string serial = text(descriptor_.iSerialNumber);
  if (!address.serial.empty() && serial != address.serial) {
    wrong = "only one with serial " + serial + " is attached";
    return false;
  }
  if (find_interface(device)) return true;
  wrong = "it has no interface for tags (class ff, subclass 45, protocol 01; drivers/tdc/USB.md)";
  return false;
}

bool Link::find_interface(libusb_device* device) {
  libusb_config_descriptor* config = nullptr;
  if (libusb_get_active_config_descriptor(device, &config) != 0) return false;
  bool found = false;
  for (int i = 0; i < config->bNumInterfaces && !found; ++i) {
    const libusb_interface& interface = config->interface[i];
    if (interface.num_altsetting == 0) continue;
    const libusb_interface_descriptor& d = interface.altsetting[0];
    if (d.bInterfaceClass != interface_class || d.bInterfaceSubClass != interface_subclass ||
        d.bInterfaceProtocol != interface_protocol)
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
  return found;
}

std::string Link::start() {
  if (const int error = libusb_claim_interface(handle_.get(), interface_))
    return reason("claim", error);
  claimed_ = true;
  Bytes answer(sizeof(Info));
  if (const int error = request(Request::info, answer); error < 0)
    return reason("ask for its properties", error);
  const auto info = read_struct<Info>(answer);
  if (!info || info->version != 1 || info->record_bytes != sizeof(Tag))
    return "it speaks another version of the protocol; expected 1 with records of 16 bytes";
  info_ = *info;
  // A former program may have left it halted, and running.
  libusb_clear_halt(handle_.get(), endpoint_);
  for (Slot& slot : slots_) {
    slot.link = this;
    slot.buffer.resize(transfer_bytes);
    slot.transfer = libusb_alloc_transfer(0);
    if (const int error = submit(slot)) return reason("queue a transfer", error);
  }
  Bytes nothing;
  if (const int error = request(Request::start, nothing); error < 0) return reason("start", error);
  started_ = true;
  return {};
}

// The answer is cut to what came. Negative: a libusb error.
int Link::request(Request what, Bytes& answer) {
  const bool in = !answer.empty();
  const std::uint8_t type = in ? vendor_in : vendor_out;
  const int got =
      libusb_control_transfer(handle_.get(), type, static_cast<std::uint8_t>(what), 0,
                              static_cast<std::uint16_t>(interface_), answer.data(),
                              static_cast<std::uint16_t>(answer.size()), request_limit_ms);
  if (got == LIBUSB_ERROR_NO_DEVICE) gone_ = true;
  if (got >= 0) answer.resize(static_cast<std::size_t>(got));
  return got;
}

std::optional<Status> Link::status() {
  Bytes answer(sizeof(Status));
  if (request(Request::status, answer) < 0) return std::nullopt;
  return read_struct<Status>(answer);
}

std::string Link::text(std::uint8_t index) {
  std::array<unsigned char, 128> buffer{};
  const int got = index == 0 ? 0
                             : libusb_get_string_descriptor_ascii(handle_.get(), index,
                                                                  buffer.data(), buffer.size());
  return got > 0 ? std::string(buffer.begin(), buffer.begin() + got) : "";
}

int Link::submit(Slot& slot) {
  if (stopping_ || gone_ || halted_) return 0;
  libusb_fill_bulk_transfer(slot.transfer, handle_.get(), endpoint_, slot.buffer.data(),
                            static_cast<int>(slot.buffer.size()), completed, &slot, 0);
  const int error = libusb_submit_transfer(slot.transfer);
  slot.busy = error == 0;
  if (error == LIBUSB_ERROR_NO_DEVICE) gone_ = true;
  if (error != 0) ++counts_.transfer_errors;
  return error;
}

void LIBUSB_CALL Link::completed(libusb_transfer* transfer) {
  Slot& slot = *static_cast<Slot*>(transfer->user_data);
  slot.busy = false;
  slot.link->on_completed(slot);
}

// What a device sent before it stalled or went is in the transfer, whatever its status.
void Link::on_completed(Slot& slot) {
  const libusb_transfer& t = *slot.transfer;
  const auto got = static_cast<std::size_t>(std::max(t.actual_length, 0));
  const bool well = t.status == LIBUSB_TRANSFER_COMPLETED;
  if (!stopping_ && (well || got > 0)) {
    ++counts_.transfers;
    counts_.bytes += got;
    on_transfer_(ByteView(slot.buffer).first(got), well && got < slot.buffer.size());
  }
  if (well) errors_in_a_row_ = 0;
  if (t.status == LIBUSB_TRANSFER_NO_DEVICE) gone_ = true;
  if (t.status == LIBUSB_TRANSFER_STALL) halted_ = true;
  if (t.status == LIBUSB_TRANSFER_ERROR || t.status == LIBUSB_TRANSFER_OVERFLOW ||
      t.status == LIBUSB_TRANSFER_TIMED_OUT) {
    ++counts_.transfer_errors;
    ++errors_in_a_row_;
    on_gap_();
  }
  submit(slot);
}

std::string Link::serve(std::chrono::milliseconds limit) {
  timeval time{.tv_sec = limit.count() / 1000, .tv_usec = limit.count() % 1000 * 1000};
  libusb_handle_events_timeout_completed(context_.get(), &time, nullptr);
  if (gone_) return "the device is gone";
  if (errors_in_a_row_ > max_errors_in_a_row) return "its transfers fail";
  if (halted_ && !any_busy()) return recover();
  if (!halted_)  // one that the system refused before
    for (Slot& slot : slots_)
      if (!slot.busy) submit(slot);
  return {};
}

// All transfers are back: the endpoint can be cleared, and the ring starts anew.
std::string Link::recover() {
  ++counts_.stalls;
  on_gap_();
  halted_ = false;
  if (const int error = libusb_clear_halt(handle_.get(), endpoint_))
    return reason("clear the halted endpoint", error);
  for (Slot& slot : slots_) submit(slot);
  return {};
}

bool Link::any_busy() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return s.busy; });
}

void Link::cancel() {
  for (Slot& slot : slots_)
    if (slot.busy) libusb_cancel_transfer(slot.transfer);
  const auto give_up = std::chrono::steady_clock::now() + cancel_limit;
  while (any_busy() && std::chrono::steady_clock::now() < give_up) {
    timeval time{.tv_sec = 0, .tv_usec = 50'000};
    libusb_handle_events_timeout_completed(context_.get(), &time, nullptr);
  }
}

}  // namespace echofuse::tdc::usb
