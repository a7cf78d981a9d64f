// SPDX-License-Identifier: MIT
#include "tests/emulation/usb_device.hpp"

#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "drivers/util/format.hpp"

namespace echofuse::sim {
namespace {

// Returns the bytes of a little-endian number in hexadecimal.
std::string hex16le(unsigned value) { return format("%02x%02x", value & 0xffu, value >> 8); }

std::string node_of(const UsbIdentity& id) { return format("/dev/bus/usb/001/%03u", id.number); }
std::string folder_of(const UsbIdentity& id) {
  return format("/devices/pci0000:00/0000:00:14.0/usb1/1-%u", id.number);
}
std::string interface_of(const UsbIdentity& id) {
  return folder_of(id) + format("/1-%u:1.0", id.number);
}

std::string describe(const UsbIdentity& id) {
  const std::string subclass = format("%02x", unsigned{id.interface_subclass}),
                    protocol = format("%02x", unsigned{id.interface_protocol});
  // Device, configuration, interface and endpoint descriptors as defined in chapter 9.6 of the USB
  // 2.0 specification.
  const std::string descriptors =
      "1201000200000040" + hex16le(id.vendor) + hex16le(id.product) + hex16le(id.release_bcd) +
      "01020301" + "090219000101008032" + "0904000001ff" + subclass + protocol + "00" + "0705" +
      format("%02x", unsigned{UsbDevice::bulk_in}) + "02" + hex16le(UsbDevice::packet_bytes) + "00";
  return lines("P: ", {folder_of(id)}) +
         lines("E: ", {"SUBSYSTEM=usb", "DRIVER=usb", "DEVTYPE=usb_device", "BUSNUM=001",
                       format("DEVNUM=%03u", id.number), "MAJOR=189",
                       format("MINOR=%u", id.number - 1), "DEVNAME=" + node_of(id)}) +
         attributes({"busnum=1", format("devnum=%u", id.number), "speed=480",
                     "bConfigurationValue=1", format("idVendor=%04x", unsigned{id.vendor}),
                     format("idProduct=%04x", unsigned{id.product}),
                     format("bcdDevice=%04x", unsigned{id.release_bcd}),
                     "manufacturer=" + id.manufacturer, "product=" + id.name,
                     "serial=" + id.serial}) +
         "H: descriptors=" + descriptors + "\n\n" + lines("P: ", {interface_of(id)}) +
         lines("E: ", {"SUBSYSTEM=usb", "DEVTYPE=usb_interface"}) +
         attributes({"bInterfaceNumber=00", "bInterfaceClass=ff", "bInterfaceSubClass=" + subclass,
                     "bInterfaceProtocol=" + protocol});
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

void UsbDevice::send(ByteView bytes, bool ends) {
  const std::lock_guard lock(mutex_);
  data_.insert(data_.end(), bytes.begin(), bytes.end());
  if (ends) ends_.push_back(data_.size());
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
  if (!pending_.empty() && !data_.empty())
    finish_first(-ENODEV, std::min(room_of_first(), data_.size()));
  clear();
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
  const auto setup = ByteReader(ByteView(buffer, 8)).get<Setup>();
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
  if (index > 3) return std::nullopt;
  const std::string& text = index == 1   ? identity_.manufacturer
                            : index == 2 ? identity_.name
                                         : identity_.serial;
  Bytes answer{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
  for (const char c : text) put(answer, std::uint16_t{static_cast<std::uint8_t>(c)});
  return answer;
}

// Moves waiting data into waiting transfers. A transfer ends when it is full or when it reaches the
// end of a run of packets. Until then, the data remain waiting.
void UsbDevice::fill() {
  while (!pending_.empty() && !halted_ && (!data_.empty() || !ends_.empty())) {
    const std::size_t room = room_of_first();
    const bool ends = !ends_.empty() && ends_.front() < room;
    const std::size_t bytes = ends ? ends_.front() : std::min(room, data_.size());
    // The transfer continues to wait if the data neither fill it nor reach the end of a run of
    // packets.
    if (!ends && bytes < room) return;
    if (ends) ends_.pop_front();
    for (std::size_t& end : ends_) end -= bytes;
    finish_first(0, bytes);
  }
}

std::size_t UsbDevice::room_of_first() const {
  return static_cast<std::size_t>(urb_of(pending_.front().urb.get()).buffer_length);
}

// Ends the oldest waiting transfer with the next bytes.
void UsbDevice::finish_first(int status, std::size_t bytes) {
  Transfer transfer = std::move(pending_.front());
  pending_.pop_front();
  const auto end = data_.begin() + static_cast<std::ptrdiff_t>(bytes);
  std::copy(data_.begin(), end, static_cast<std::uint8_t*>(urb_of(transfer.urb.get()).buffer));
  data_.erase(data_.begin(), end);
  fetched_ += bytes;
  finish(std::move(transfer), status, bytes);
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
