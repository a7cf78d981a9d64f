// SPDX-License-Identifier: MIT
#include "tests/emulation/usb_device.hpp"

#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <iomanip>
#include <sstream>

namespace echofuse::sim {
namespace {

std::string hex(std::uint64_t value, int digits) {
  std::ostringstream out;
  out << std::hex << std::setfill('0') << std::setw(digits) << value;
  return out.str();
}

std::string hex16le(std::uint16_t value) { return hex(value & 0xffu, 2) + hex(value >> 8, 2); }

std::string node_of(const UsbIdentity& id) {
  std::ostringstream out;
  out << "/dev/bus/usb/001/" << std::setfill('0') << std::setw(3) << id.number;
  return out.str();
}
std::string folder_of(const UsbIdentity& id) {
  return "/devices/pci0000:00/0000:00:14.0/usb1/1-" + std::to_string(id.number);
}
std::string interface_of(const UsbIdentity& id) {
  return folder_of(id) + "/1-" + std::to_string(id.number) + ":1.0";
}

// Returns the device, configuration, interface and endpoint descriptors as defined in chapter 9.6
// of the USB 2.0 specification.
std::string descriptors(const UsbIdentity& id) {
  return "12010002000000" + std::string("40") + hex16le(id.vendor) + hex16le(id.product) +
         hex16le(id.release_bcd) + "01020301" + "09021900010100" + "8032" + "090400000" + "1ff" +
         hex(id.interface_subclass, 2) + hex(id.interface_protocol, 2) + "00" + "0705" +
         hex(UsbDevice::bulk_in, 2) + "02" + hex16le(UsbDevice::packet_bytes) + "00";
}

std::string describe(const UsbIdentity& id) {
  std::ostringstream out;
  const auto attribute = [&](const char* name, const std::string& value) {
    out << "A: " << name << '=' << value << "\\n\n";
  };
  const std::string node = node_of(id);
  out << "P: " << folder_of(id) << "\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: DEVTYPE=usb_device\n"
      << "E: BUSNUM=001\nE: DEVNUM=" << node.substr(node.size() - 3)
      << "\nE: MAJOR=189\nE: MINOR=" << id.number - 1 << "\nE: DEVNAME=" << node << '\n';
  attribute("busnum", "1");
  attribute("devnum", std::to_string(id.number));
  attribute("speed", "480");
  attribute("bConfigurationValue", "1");
  attribute("idVendor", hex(id.vendor, 4));
  attribute("idProduct", hex(id.product, 4));
  attribute("bcdDevice", hex(id.release_bcd, 4));
  attribute("manufacturer", id.manufacturer);
  attribute("product", id.name);
  attribute("serial", id.serial);
  out << "H: descriptors=" << descriptors(id) << "\n\n"
      << "P: " << interface_of(id) << "\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_interface\n";
  attribute("bInterfaceNumber", "00");
  attribute("bInterfaceClass", "ff");
  attribute("bInterfaceSubClass", hex(id.interface_subclass, 2));
  attribute("bInterfaceProtocol", hex(id.interface_protocol, 2));
  return out.str();
}

usbdevfs_urb& urb_of(UMockdevIoctlData* data) {
  return *reinterpret_cast<usbdevfs_urb*>(data->data);
}

}  // namespace

UsbDevice::UsbDevice(UsbBed& bed, const UsbIdentity& identity, Control control)
    : BedNode(bed, node_of(identity), describe(identity),
              {folder_of(identity), interface_of(identity)}),
      identity_(identity),
      control_(std::move(control)) {}

UsbDevice::~UsbDevice() { detach(); }

void UsbDevice::send(ByteView run) {
  const std::lock_guard lock(mutex_);
  data_.insert(data_.end(), run.begin(), run.end());
  ends_.push_back(data_.size());
  fill();
}

void UsbDevice::send_more(ByteView bytes) {
  const std::lock_guard lock(mutex_);
  data_.insert(data_.end(), bytes.begin(), bytes.end());
  fill();
}

std::size_t UsbDevice::waiting() const {
  const std::lock_guard lock(mutex_);
  return data_.size();
}

void UsbDevice::clear() {
  const std::lock_guard lock(mutex_);
  data_.clear();
  ends_.clear();
}

void UsbDevice::halt() {
  const std::lock_guard lock(mutex_);
  halted_ = true;
  finish_all(-EPIPE);
}

std::uint64_t UsbDevice::fetched() const {
  const std::lock_guard lock(mutex_);
  return fetched_;
}

bool UsbDevice::claimed() const {
  const std::lock_guard lock(mutex_);
  return owner_ != nullptr;
}

// Reduces the pipe to one page. While the pipe contains a byte, poll() reports to the client that
// the node is not writable. In usbfs, this state means that no URB is ready.
void UsbDevice::on_plug(int fifo) {
  const std::lock_guard lock(mutex_);
  fifo_ = fifo;
  ::fcntl(fifo_, F_SETPIPE_SZ, 4096);
  gone_ = halted_ = false;
  reapable_ = true;
  set_reapable(false);
}

void UsbDevice::on_unplug() {
  const std::lock_guard lock(mutex_);
  gone_ = true;
  // The waiting transfer ends with the data that have been sent of the unfinished run of packets.
  if (!pending_.empty() && !data_.empty()) {
    Transfer transfer = std::move(pending_.front());
    pending_.pop_front();
    const usbdevfs_urb& urb = urb_of(transfer.urb.get());
    const std::size_t bytes = std::min(static_cast<std::size_t>(urb.buffer_length), data_.size());
    std::copy_n(data_.begin(), bytes, static_cast<std::uint8_t*>(urb.buffer));
    fetched_ += bytes;
    finish(std::move(transfer), -ENODEV, bytes);
  }
  data_.clear();
  ends_.clear();
  finish_all(-ENODEV);
  set_reapable(true);
}

void UsbDevice::on_client_gone(Client client) {
  const std::lock_guard lock(mutex_);
  const auto his = [&](const Transfer& t) { return t.client == client; };
  std::erase_if(pending_, his);
  std::erase_if(done_, his);
  if (owner_ == client) owner_ = nullptr;
  if (done_.empty() && !gone_) set_reapable(false);
}

void UsbDevice::set_reapable(bool reapable) {
  if (std::exchange(reapable_, reapable) == reapable || fifo_ < 0) return;
  char byte = 0;
  if (!reapable) [[maybe_unused]]
    const auto written = ::write(fifo_, &byte, 1);
  else
    while (::read(fifo_, &byte, 1) == 1) {
    }
}

UsbDevice::Answer UsbDevice::on_ioctl(Client client, unsigned long request,
                                      UMockdevIoctlData* argument) {
  const std::lock_guard lock(mutex_);
  if (gone_ && request != USBDEVFS_REAPURB && request != USBDEVFS_REAPURBNDELAY)
    return fail(ENODEV);
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
      return capabilities(argument);
    case USBDEVFS_GETDRIVER:
      return fail(ENODATA);
    case USBDEVFS_CLAIMINTERFACE:
      return claim(client);
    case USBDEVFS_RELEASEINTERFACE:
      if (owner_ == client) owner_ = nullptr;
      return {0};
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_RESET:
      return {0};
    case USBDEVFS_CLEAR_HALT:
      halted_ = false;
      fill();
      return {0};
    case USBDEVFS_SUBMITURB:
      return submit(client, argument);
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY:
      return reap(client, argument);
    case USBDEVFS_DISCARDURB:
      return discard(client, argument);
    default:
      return fail(ENOTTY);
  }
}

// Does not report the scatter-gather capability, so that libusb splits transfers into pieces of 16
// KiB.
UsbDevice::Answer UsbDevice::capabilities(UMockdevIoctlData* argument) {
  const ClientData data = resolve(argument, 0, sizeof(std::uint32_t));
  if (!data) return fail(EFAULT);
  const std::uint32_t all = USBDEVFS_CAP_BULK_SCATTER_GATHER | USBDEVFS_CAP_BULK_CONTINUATION |
                            USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT |
                            USBDEVFS_CAP_ZERO_PACKET;
  std::memcpy(data->data, &all, sizeof all);
  return {0};
}

UsbDevice::Answer UsbDevice::claim(Client client) {
  if (owner_ && owner_ != client) return fail(EBUSY);
  owner_ = client;
  return {0};
}

UsbDevice::Answer UsbDevice::submit(Client client, UMockdevIoctlData* argument) {
  Transfer transfer{client, resolve(argument, 0, sizeof(usbdevfs_urb))};
  if (!transfer.urb) return fail(EFAULT);
  const usbdevfs_urb& urb = urb_of(transfer.urb.get());
  if (urb.buffer_length > 0 && !resolve(transfer.urb.get(), offsetof(usbdevfs_urb, buffer),
                                        static_cast<std::size_t>(urb.buffer_length)))
    return fail(EFAULT);
  if (urb.type == USBDEVFS_URB_TYPE_CONTROL) {
    control(std::move(transfer));
  } else if (urb.endpoint == bulk_in) {
    if (halted_)
      finish(std::move(transfer), -EPIPE, 0);
    else
      pending_.push_back(std::move(transfer));
    fill();
  } else {
    return fail(ENOENT);
  }
  return {0};
}

UsbDevice::Answer UsbDevice::reap(Client client, UMockdevIoctlData* argument) {
  const auto next = std::find_if(done_.begin(), done_.end(),
                                 [&](const Transfer& t) { return t.client == client; });
  if (next == done_.end()) {
    if (done_.empty() && !gone_) set_reapable(false);
    return fail(gone_ ? ENODEV : EAGAIN);
  }
  const Transfer transfer = std::move(*next);
  done_.erase(next);
  if (done_.empty() && !gone_) set_reapable(false);
  const ClientData pointer = resolve(argument, 0, sizeof(void*));
  if (!pointer) return fail(EFAULT);
  umockdev_ioctl_data_set_ptr(pointer.get(), 0, transfer.urb.get());
  return {0};
}

UsbDevice::Answer UsbDevice::discard(Client client, UMockdevIoctlData* argument) {
  unsigned long address = 0;
  std::memcpy(&address, argument->data, sizeof address);
  const auto found = std::find_if(pending_.begin(), pending_.end(), [&](const Transfer& t) {
    return t.client == client && t.urb->client_addr == address;
  });
  if (found == pending_.end()) return fail(EINVAL);
  Transfer transfer = std::move(*found);
  pending_.erase(found);
  finish(std::move(transfer), -ENOENT, 0);
  return {0};
}

void UsbDevice::control(Transfer transfer) {
  const usbdevfs_urb& urb = urb_of(transfer.urb.get());
  auto* buffer = static_cast<std::uint8_t*>(urb.buffer);
  if (urb.buffer_length < 8) return finish(std::move(transfer), -EPIPE, 0);
  ByteReader reader(ByteView(buffer, 8));
  Setup setup{};
  setup.type = reader.get<std::uint8_t>();
  setup.request = reader.get<std::uint8_t>();
  setup.value = reader.get<std::uint16_t>();
  setup.index = reader.get<std::uint16_t>();
  setup.length = reader.get<std::uint16_t>();
  const bool vendor = (setup.type & 0x60) == 0x40;
  const auto answer = vendor ? control_(setup) : string_descriptor(setup);
  if (!answer) return finish(std::move(transfer), -EPIPE, 0);
  const std::size_t room =
      std::min<std::size_t>(setup.length, static_cast<std::size_t>(urb.buffer_length) - 8);
  const std::size_t bytes = setup.in() ? std::min(answer->size(), room) : room;
  if (setup.in()) std::copy_n(answer->begin(), bytes, buffer + 8);
  finish(std::move(transfer), 0, bytes);
}

// Answers requests for string descriptors (GET_DESCRIPTOR). libusb passes no other standard request
// to the device.
std::optional<Bytes> UsbDevice::string_descriptor(const Setup& setup) const {
  if (setup.type != 0x80 || setup.request != 6 || setup.value >> 8 != 3) return std::nullopt;
  const unsigned index = setup.value & 0xffu;
  if (index == 0) return Bytes{4, 3, 9, 4};  // the only language is US English
  const std::string* const texts[] = {&identity_.manufacturer, &identity_.name, &identity_.serial};
  if (index > 3) return std::nullopt;
  const std::string& text = *texts[index - 1];
  Bytes answer{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
  for (const char c : text) {
    answer.push_back(static_cast<std::uint8_t>(c));
    answer.push_back(0);
  }
  return answer;
}

// Moves waiting data into waiting transfers. A transfer ends when it is full or when it reaches the
// end of a run of packets. Until then, the data remain waiting.
void UsbDevice::fill() {
  while (!pending_.empty() && !halted_ && (!data_.empty() || !ends_.empty())) {
    const usbdevfs_urb& urb = urb_of(pending_.front().urb.get());
    const auto room = static_cast<std::size_t>(urb.buffer_length);
    const bool ends = !ends_.empty() && ends_.front() < room;
    const std::size_t bytes = ends ? ends_.front() : std::min(room, data_.size());
    // The transfer continues to wait if the data neither fill it nor reach the end of a run of
    // packets.
    if (!ends && bytes < room) return;
    std::copy_n(data_.begin(), bytes, static_cast<std::uint8_t*>(urb.buffer));
    data_.erase(data_.begin(), data_.begin() + static_cast<std::ptrdiff_t>(bytes));
    if (ends) ends_.pop_front();
    for (std::size_t& end : ends_) end -= bytes;
    fetched_ += bytes;
    Transfer transfer = std::move(pending_.front());
    pending_.pop_front();
    finish(std::move(transfer), 0, bytes);
  }
}

void UsbDevice::finish(Transfer transfer, int status, std::size_t bytes) {
  usbdevfs_urb& urb = urb_of(transfer.urb.get());
  urb.status = status;
  urb.actual_length = static_cast<int>(bytes);
  done_.push_back(std::move(transfer));
  set_reapable(true);
}

void UsbDevice::finish_all(int status) {
  for (Transfer& transfer : pending_) finish(std::move(transfer), status, 0);
  pending_.clear();
}

}  // namespace echofuse::sim
