// SPDX-License-Identifier: MIT
#include "sim/usb/hid_cp2110.hpp"

#include <fcntl.h>
#include <linux/hidraw.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <thread>
#include <vector>

#include "drivers/core/exit_code.hpp"
#include "sim/usb/cp2110_chip.hpp"

namespace echofuse::sim {
namespace {

constexpr auto usb_frame = std::chrono::milliseconds(1);
// One packet of a pipe is one page: 64 reports, the kernel's HIDRAW_BUFFER_SIZE.
constexpr int host_buffer_bytes = 64 * 4096;

constexpr std::uint8_t descriptor[] = {0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x85, 0x01,
                                       0x95, 0x01, 0x26, 0xFF, 0x00, 0x75, 0x08, 0x09, 0x01,
                                       0x81, 0x02, 0x09, 0x01, 0x91, 0x02, 0xC0};
constexpr const char* descriptor_hex = "0600FF0901A1018501950126FF0075080901810209019102C0";
constexpr const char* product_name = "CP2110 HID USB-to-UART Bridge";

std::string hex4(unsigned value) {
  std::array<char, 8> text{};
  std::snprintf(text.data(), text.size(), "%04X", value);
  return text.data();
}

}  // namespace

struct HidCp2110::Parts {
  Parts(UMockdevTestbed* testbed, HidOptions o, std::function<void(ByteView)> transmit)
      : bed(testbed), options(std::move(o)), chip(std::move(transmit)) {
    char* folder = umockdev_testbed_get_root_dir(bed);
    root = folder;
    g_free(folder);
    const std::string number = std::to_string(options.number + 1);
    node = "/dev/hidraw" + std::to_string(options.number);
    usb = "/devices/pci0000:00/0000:00:14.0/usb1/1-" + number;
    interface = usb + "/1-" + number + ":1.0";
    id = "0003:10C4:EA80." + hex4(options.number + 1);
    hid = interface + "/" + id;
    raw = hid + "/hidraw/hidraw" + std::to_string(options.number);
  }

  std::string description() const;
  void make_node();
  void drain();
  void input(ByteView report);
  void pump();
  long ioctl(unsigned long request, UMockdevIoctlData* argument, int& error);

  UMockdevTestbed* bed;
  HidOptions options;
  std::string root, node, usb, interface, id, hid, raw;
  UMockdevIoctlBase* handler = nullptr;

  std::mutex mutex;  // of the rest
  std::condition_variable wake;
  Cp2110Chip chip;
  int fifo = -1;
  bool plugged = false, ending = false;
  std::uint64_t host_dropped = 0, output_reports = 0;
  std::thread pump_thread;
};

std::string HidCp2110::Parts::description() const {
  const std::string number = std::to_string(options.number + 2), product = "EA80";
  return "P: " + usb + "\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: DEVTYPE=usb_device\nE: BUSNUM=001\n" +
         "E: DEVNUM=00" + number + "\nE: PRODUCT=10c4/" + product +
         "/100\nA: idVendor=10c4\\n\nA: idProduct=" + product +
         "\\n\nA: bcdDevice=0100\\n\nA: manufacturer=Silicon Laboratories\\n\nA: product=" +
         product_name + "\\n\nA: serial=" + options.serial +
         "\\n\nA: busnum=1\\n\nA: devnum=" + number + "\\n\n\nP: " + interface +
         "\nE: SUBSYSTEM=usb\nE: DRIVER=usbhid\nE: DEVTYPE=usb_interface\nE: INTERFACE=3/0/0\n"
         "A: bInterfaceNumber=00\\n\nA: bInterfaceClass=03\\n\n\nP: " +
         hid + "\nE: SUBSYSTEM=hid\nE: DRIVER=hid-generic\nE: HID_ID=0003:000010C4:0000" + product +
         "\nE: HID_NAME=Silicon Laboratories " + product_name +
         "\nE: HID_PHYS=usb-0000:00:14.0-1/input0\nE: HID_UNIQ=" + options.serial +
         "\nH: report_descriptor=" + descriptor_hex + "\n\nP: " + raw +
         "\nE: SUBSYSTEM=hidraw\nE: DEVNAME=" + node +
         "\nE: MAJOR=240\nE: MINOR=" + std::to_string(options.number) + "\nL: device=../../../" +
         id + "\n";
}

// In packet mode: poll() works, and one read() takes one report.
void HidCp2110::Parts::make_node() {
  const std::string path = root + node;
  std::filesystem::create_directories(root + "/dev");
  std::filesystem::remove(path);
  if (fifo >= 0) ::close(fifo);
  if (::mkfifo(path.c_str(), 0666) == 0)
    fifo = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  else
    fifo = -1;
  if (fifo < 0 || ::fcntl(fifo, F_SETPIPE_SZ, host_buffer_bytes) < 0 ||
      ::fcntl(fifo, F_SETFL, O_RDWR | O_NONBLOCK | O_DIRECT) < 0)
    throw Error(ExitCode::failed, path + ": " + std::strerror(errno));
}

// The kernel keeps reports for whom has the node open, from then on.
void HidCp2110::Parts::drain() {
  Cp2110Chip::Report report;
  while (::read(fifo, report.data(), report.size()) > 0) {
  }
}

void HidCp2110::Parts::input(ByteView report) {
  if (::write(fifo, report.data(), report.size()) < 0) ++host_dropped;
}

// One interrupt IN a USB frame.
void HidCp2110::Parts::pump() {
  std::unique_lock lock(mutex);
  auto next = std::chrono::steady_clock::now();
  while (!ending) {
    if (!plugged || !chip.waiting()) {
      wake.wait(lock, [this] { return ending || (plugged && chip.waiting()); });
      next = std::max(next, std::chrono::steady_clock::now());
      continue;
    }
    if (const auto report = chip.next_input()) input(*report);
    next += usb_frame;
    wake.wait_until(lock, next, [this] { return ending; });
  }
}

// The size field of a request is the buffer's for most of them, so its number tells which it is.
long HidCp2110::Parts::ioctl(unsigned long request, UMockdevIoctlData* argument, int& error) {
  const std::size_t size = _IOC_SIZE(request);
  UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, size, nullptr);
  if (!data) {
    error = EFAULT;
    return -1;
  }
  long result = 0;
  const auto put = [&](ByteView bytes) {
    const std::size_t n = std::min(size, bytes.size());
    std::memcpy(data->data, bytes.data(), n);
    return static_cast<long>(n);
  };
  switch (_IOC_NR(request)) {
    case _IOC_NR(HIDIOCGRDESCSIZE): {
      const int bytes = sizeof descriptor;
      std::memcpy(data->data, &bytes, sizeof bytes);
      break;
    }
    case _IOC_NR(HIDIOCGRDESC): {
      auto* out = reinterpret_cast<hidraw_report_descriptor*>(data->data);
      std::memcpy(out->value, descriptor, std::min<std::size_t>(out->size, sizeof descriptor));
      break;
    }
    case _IOC_NR(HIDIOCGRAWINFO): {
      const hidraw_devinfo info{3, static_cast<short>(0x10C4), static_cast<short>(0xEA80)};
      std::memcpy(data->data, &info, sizeof info);
      break;
    }
    case _IOC_NR(HIDIOCSFEATURE(0)):
      result = chip.set_feature({data->data, size}) ? static_cast<long>(size) : -1;
      break;
    case _IOC_NR(HIDIOCGFEATURE(0)): {
      const auto report = chip.get_feature(data->data[0]);
      result = report ? put(*report) : -1;
      break;
    }
    default:
      result = -1;
  }
  if (result < 0) error = EPIPE;
  g_object_unref(data);
  return result;
}

namespace {

using Parts = HidCp2110::Parts;

gboolean answer(UMockdevIoctlClient* client, long result, int error) {
  umockdev_ioctl_client_complete(client, result, error);
  return TRUE;
}

gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, Parts* parts) {
  const std::lock_guard lock(parts->mutex);
  if (!parts->plugged) return answer(client, -1, ENODEV);
  int error = 0;
  const long result = parts->ioctl(umockdev_ioctl_client_get_request(client),
                                   umockdev_ioctl_client_get_arg(client), error);
  return answer(client, result, error);
}

gboolean on_write(UMockdevIoctlBase*, UMockdevIoctlClient* client, Parts* parts) {
  const std::lock_guard lock(parts->mutex);
  if (!parts->plugged) return answer(client, -1, ENODEV);
  const UMockdevIoctlData* data = umockdev_ioctl_client_get_arg(client);
  const auto size = static_cast<std::size_t>(data->data_len);
  if (!parts->chip.output({data->data, size})) return answer(client, -1, EINVAL);
  ++parts->output_reports;
  return answer(client, data->data_len, 0);
}

// FALSE: the read goes to the pipe.
gboolean on_read(UMockdevIoctlBase*, UMockdevIoctlClient* client, Parts* parts) {
  const std::lock_guard lock(parts->mutex);
  return parts->plugged ? FALSE : answer(client, -1, EIO);
}

void on_client(UMockdevIoctlBase*, UMockdevIoctlClient*, Parts* parts) {
  const std::lock_guard lock(parts->mutex);
  parts->drain();
}

}  // namespace

HidCp2110::HidCp2110(UMockdevTestbed* bed, HidOptions options,
                     std::function<void(ByteView)> transmit)
    : parts_(std::make_unique<Parts>(bed, std::move(options), std::move(transmit))) {
  Parts* parts = parts_.get();
  parts->handler = umockdev_ioctl_base_new();
  g_signal_connect(parts->handler, "handle-ioctl", G_CALLBACK(on_ioctl), parts);
  g_signal_connect(parts->handler, "handle-write", G_CALLBACK(on_write), parts);
  g_signal_connect(parts->handler, "handle-read", G_CALLBACK(on_read), parts);
  g_signal_connect(parts->handler, "client-connected", G_CALLBACK(on_client), parts);
  GError* error = nullptr;
  if (!umockdev_testbed_attach_ioctl(bed, parts->node.c_str(), parts->handler, &error)) {
    const Error wrong(ExitCode::failed, parts->node + ": " + error->message);
    g_error_free(error);
    throw wrong;
  }
  parts->pump_thread = std::thread([parts] { parts->pump(); });
  plug();
}

HidCp2110::~HidCp2110() {
  unplug();
  {
    const std::lock_guard lock(parts_->mutex);
    parts_->ending = true;
  }
  parts_->wake.notify_all();
  parts_->pump_thread.join();
  umockdev_testbed_detach_ioctl(parts_->bed, parts_->node.c_str(), nullptr);
  g_object_unref(parts_->handler);
  ::close(parts_->fifo);
}

void HidCp2110::plug() {
  {
    const std::lock_guard lock(parts_->mutex);
    if (parts_->plugged) return;
    parts_->make_node();
    parts_->plugged = true;
  }
  GError* error = nullptr;
  if (!umockdev_testbed_add_from_string(parts_->bed, parts_->description().c_str(), &error)) {
    const Error wrong(ExitCode::failed, parts_->node + ": " + error->message);
    g_error_free(error);
    throw wrong;
  }
}

// The byte wakes who polls; the read that follows answers EIO. Children go before their parents.
void HidCp2110::unplug() {
  {
    const std::lock_guard lock(parts_->mutex);
    if (!parts_->plugged) return;
    parts_->plugged = false;
    parts_->chip.set_feature(Bytes{0x43, 3});
    parts_->chip.set_feature(Bytes{0x41, 0});
    const std::uint8_t byte = 0;
    parts_->input({&byte, 1});
  }
  umockdev_testbed_uevent(parts_->bed, ("/sys" + parts_->raw).c_str(), "remove");
  std::filesystem::remove(parts_->root + parts_->node);
  for (const std::string& device : {parts_->raw, parts_->hid, parts_->interface, parts_->usb})
    umockdev_testbed_remove_device(parts_->bed, ("/sys" + device).c_str());
}

std::size_t HidCp2110::receive(ByteView bytes) {
  const std::lock_guard lock(parts_->mutex);
  if (!parts_->plugged) return 0;
  const std::size_t fits = parts_->chip.receive(bytes);
  parts_->wake.notify_all();
  return fits;
}

void HidCp2110::raw_input(ByteView report) {
  const std::lock_guard lock(parts_->mutex);
  if (parts_->plugged) parts_->input(report);
}

std::uint32_t HidCp2110::baud() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->chip.baud();
}

Bytes HidCp2110::config() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->chip.config();
}

bool HidCp2110::on() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->chip.on();
}

std::size_t HidCp2110::host_waiting() const {
  const std::lock_guard lock(parts_->mutex);
  int bytes = 0;
  ::ioctl(parts_->fifo, FIONREAD, &bytes);
  return static_cast<std::size_t>(bytes);
}

std::uint64_t HidCp2110::host_dropped() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->host_dropped;
}

std::uint64_t HidCp2110::output_reports() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->output_reports;
}

}  // namespace echofuse::sim
