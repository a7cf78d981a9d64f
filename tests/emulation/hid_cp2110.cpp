// SPDX-License-Identifier: MIT
#include "tests/emulation/hid_cp2110.hpp"

#include <fcntl.h>
#include <linux/hidraw.h>
#include <sys/ioctl.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::sim {
namespace {

constexpr auto usb_frame = std::chrono::milliseconds(1);
// The pipe uses one page for each packet. The kernel limits its buffer to 64 reports
// (HIDRAW_BUFFER_SIZE).
constexpr int host_buffer_bytes = 64 * 4096;

constexpr std::uint8_t descriptor[] = {0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x85, 0x01,
                                       0x95, 0x01, 0x26, 0xFF, 0x00, 0x75, 0x08, 0x09, 0x01,
                                       0x81, 0x02, 0x09, 0x01, 0x91, 0x02, 0xC0};
constexpr const char* descriptor_hex = "0600FF0901A1018501950126FF0075080901810209019102C0";

// Returns the folders of the device in /sys. Parent folders come first.
std::vector<std::string> folders(unsigned number) {
  const std::string usb = format("/devices/pci0000:00/0000:00:14.0/usb1/1-%u", number + 1),
                    interface = usb + format("/1-%u:1.0", number + 1),
                    hid = interface + format("/0003:10C4:EA80.%04X", number + 1);
  return {usb, interface, hid, hid + format("/hidraw/hidraw%u", number)};
}

std::string node_of(unsigned number) { return format("/dev/hidraw%u", number); }

std::string describe(const HidOptions& options) {
  const unsigned device = options.number + 2;
  const std::string maker = "Silicon Laboratories", product = "CP2110 HID USB-to-UART Bridge";
  const auto at = folders(options.number);
  return lines("P: ", {at[0]}) +
         lines("E: ", {"SUBSYSTEM=usb", "DRIVER=usb", "DEVTYPE=usb_device", "BUSNUM=001",
                       format("DEVNUM=%03u", device), "PRODUCT=10c4/EA80/100"}) +
         attributes({"idVendor=10c4", "idProduct=EA80", "bcdDevice=0100", "manufacturer=" + maker,
                     "product=" + product, "serial=" + options.serial, "busnum=1",
                     format("devnum=%u", device)}) +
         lines("\nP: ", {at[1]}) +
         lines("E: ",
               {"SUBSYSTEM=usb", "DRIVER=usbhid", "DEVTYPE=usb_interface", "INTERFACE=3/0/0"}) +
         attributes({"bInterfaceNumber=00", "bInterfaceClass=03"}) + lines("\nP: ", {at[2]}) +
         lines("E: ", {"SUBSYSTEM=hid", "DRIVER=hid-generic", "HID_ID=0003:000010C4:0000EA80",
                       "HID_NAME=" + maker + " " + product, "HID_PHYS=usb-0000:00:14.0-1/input0",
                       "HID_UNIQ=" + options.serial}) +
         "H: report_descriptor=" + descriptor_hex + "\n" + lines("\nP: ", {at[3]}) +
         lines("E: ", {"SUBSYSTEM=hidraw", "DEVNAME=" + node_of(options.number), "MAJOR=240",
                       format("MINOR=%u", options.number)}) +
         "L: device=../../../" + at[2].substr(at[2].rfind('/') + 1) + "\n";
}

}  // namespace

HidCp2110::HidCp2110(UsbBed& bed, const HidOptions& options, std::function<void(ByteView)> transmit)
    : BedNode(bed, node_of(options.number), describe(options), folders(options.number)),
      chip_(std::move(transmit)),
      pump_thread_([this] { pump(); }) {
  plug();
}

HidCp2110::~HidCp2110() {
  unplug();
  detach();
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  pump_thread_.join();
}

// Sets the packet mode of the pipe, so that poll() works and each read() returns one report.
void HidCp2110::on_plug(int fifo) {
  const std::lock_guard lock(mutex_);
  fifo_ = fifo;
  if (::fcntl(fifo, F_SETPIPE_SZ, host_buffer_bytes) < 0 ||
      ::fcntl(fifo, F_SETFL, O_RDWR | O_NONBLOCK | O_DIRECT) < 0)
    throw Error(ExitCode::failed,
                std::string("HID emulation: packet mode: ") + std::strerror(errno));
  plugged_ = true;
}

// Writes a byte to wake programs that wait in poll(). Their next read() fails with EIO.
void HidCp2110::on_unplug() {
  const std::lock_guard lock(mutex_);
  plugged_ = false;
  chip_.set_feature(Bytes{0x43, 3});
  chip_.set_feature(Bytes{0x41, 0});
  const std::uint8_t byte = 0;
  input({&byte, 1});
}

std::optional<BedNode::Answer> HidCp2110::on_read() {
  const std::lock_guard lock(mutex_);
  if (plugged_) return std::nullopt;
  return fail(EIO);
}

std::optional<BedNode::Answer> HidCp2110::on_write(ByteView bytes) {
  const std::lock_guard lock(mutex_);
  if (!plugged_) return fail(ENODEV);
  if (!chip_.output(bytes)) return fail(EINVAL);
  return Answer{static_cast<long>(bytes.size())};
}

// Discards the reports sent before a client opened the node, as the kernel does.
void HidCp2110::on_client() {
  const std::lock_guard lock(mutex_);
  ++opened_;
  Cp2110Chip::Report report;
  while (::read(fifo_, report.data(), report.size()) > 0) {
  }
}

void HidCp2110::input(ByteView report) {
  if (::write(fifo_, report.data(), report.size()) < 0) ++host_dropped_;
}

// Sends one interrupt IN transfer per USB frame.
void HidCp2110::pump() {
  std::unique_lock lock(mutex_);
  auto next = std::chrono::steady_clock::now();
  while (!ending_) {
    if (!plugged_ || !chip_.waiting()) {
      wake_.wait(lock, [this] { return ending_ || (plugged_ && chip_.waiting()); });
      next = std::max(next, std::chrono::steady_clock::now());
      continue;
    }
    if (const auto report = chip_.next_input()) input(*report);
    next += usb_frame;
    wake_.wait_until(lock, next, [this] { return ending_; });
  }
}

// Identifies requests only by their number, because the size field of most requests depends on the
// client's buffer.
BedNode::Answer HidCp2110::on_ioctl(Client, unsigned long request, UMockdevIoctlData* argument) {
  const std::lock_guard lock(mutex_);
  if (!plugged_) return fail(ENODEV);
  const std::size_t size = _IOC_SIZE(request);
  const ClientData data = resolve(argument, 0, size);
  if (!data) return fail(EFAULT);
  switch (_IOC_NR(request)) {
    case _IOC_NR(HIDIOCGRDESCSIZE): {
      const int bytes = sizeof descriptor;
      std::memcpy(data->data, &bytes, sizeof bytes);
      return {0};
    }
    case _IOC_NR(HIDIOCGRDESC): {
      auto* out = reinterpret_cast<hidraw_report_descriptor*>(data->data);
      std::memcpy(out->value, descriptor, std::min<std::size_t>(out->size, sizeof descriptor));
      return {0};
    }
    case _IOC_NR(HIDIOCGRAWINFO): {
      const hidraw_devinfo info{3, static_cast<short>(0x10C4), static_cast<short>(0xEA80)};
      std::memcpy(data->data, &info, sizeof info);
      return {0};
    }
    case _IOC_NR(HIDIOCSFEATURE(0)):
      if (!chip_.set_feature({data->data, size})) return fail(EPIPE);
      return {static_cast<long>(size)};
    case _IOC_NR(HIDIOCGFEATURE(0)): {
      const auto report = chip_.get_feature(data->data[0]);
      if (!report) return fail(EPIPE);
      const std::size_t bytes = std::min(size, report->size());
      std::memcpy(data->data, report->data(), bytes);
      return {static_cast<long>(bytes)};
    }
    default:
      return fail(EPIPE);
  }
}

std::size_t HidCp2110::receive(ByteView bytes) {
  const std::lock_guard lock(mutex_);
  if (!plugged_) return 0;
  const std::size_t fits = chip_.receive(bytes);
  wake_.notify_all();
  return fits;
}

void HidCp2110::raw_input(ByteView report) {
  const std::lock_guard lock(mutex_);
  if (plugged_) input(report);
}

std::size_t HidCp2110::host_waiting() const {
  const std::lock_guard lock(mutex_);
  int bytes = 0;
  ::ioctl(fifo_, FIONREAD, &bytes);
  return static_cast<std::size_t>(bytes);
}

}  // namespace echofuse::sim
