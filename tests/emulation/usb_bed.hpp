// SPDX-License-Identifier: MIT
// Devices below the kernel's usbfs and hidraw interfaces, for unmodified programs: umockdev answers
// their system calls and shows them a sysfs of its own. A program sees the bed if it was started
// with environment(); this process must have gone through enter() itself.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/bytes.hpp"

typedef struct _UMockdevTestbed UMockdevTestbed;
typedef struct _UMockdevIoctlBase UMockdevIoctlBase;
typedef struct _UMockdevIoctlClient UMockdevIoctlClient;
typedef struct _UMockdevIoctlData UMockdevIoctlData;

namespace echofuse::sim {

class UsbBed {
 public:
  // Starts this program anew below umockdev's preload library, once; call it first in main().
  static void enter(char** argv);

  // One at a time in a process (umockdev's rule). Throws Error(failed).
  UsbBed();
  ~UsbBed();
  UsbBed(const UsbBed&) = delete;
  UsbBed& operator=(const UsbBed&) = delete;

  // Environment that a program needs to see the devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  const std::string& root() const { return root_; }
  UMockdevTestbed* testbed() const { return testbed_; }

 private:
  UMockdevTestbed* testbed_;
  std::string root_;
};

// A node in /dev whose system calls a simulated device answers. Behind it is a FIFO, so that poll()
// on it means something.
// Threading: made, plugged and unplugged on one thread; the on_ functions are called on umockdev's.
class BedNode {
 public:
  struct Answer {
    long result;    // the system call's
    int error = 0;  // errno if the result is -1
  };
  static Answer fail(int error) { return {-1, error}; }
  // Who has the node open; never dereferenced.
  using Client = const void*;

  virtual ~BedNode();
  BedNode(const BedNode&) = delete;
  BedNode& operator=(const BedNode&) = delete;

  void plug();
  void unplug();

 protected:
  // `description` is umockdev's text (P: E: A: H: L: lines, no N:), `folders` the devices in it
  // below /sys, parents first.
  BedNode(UsbBed& bed, std::string node, std::string description, std::vector<std::string> folders);
  // Answers nothing more: first thing in the destructor of the class that answers.
  void detach();

  // When the node's FIFO is new, before the device is announced; and when the device is gone,
  // before that is announced.
  virtual void on_plug(int fifo) = 0;
  virtual void on_unplug() = 0;
  virtual Answer on_ioctl(Client client, unsigned long request, UMockdevIoctlData* argument) = 0;
  // No value: the FIFO answers.
  virtual std::optional<Answer> on_read() { return std::nullopt; }
  virtual std::optional<Answer> on_write(ByteView) { return std::nullopt; }
  virtual void on_client() {}
  virtual void on_client_gone(Client) {}

 private:
  struct Callbacks;
  void make_fifo();

  UsbBed& bed_;
  std::string node_, description_;
  std::vector<std::string> folders_;
  UMockdevIoctlBase* handler_;
  std::shared_ptr<Callbacks> callbacks_;
  int fifo_ = -1;
  bool attached_ = false, plugged_ = false;
};

// The client's memory behind a system call's argument: `bytes` from `offset`, or from the pointer
// that stands there. Null if he is gone. Released when it goes out of scope; writes reach the
// client when the call is answered.
struct DataRelease {
  void operator()(UMockdevIoctlData* data) const;
};
using ClientData = std::unique_ptr<UMockdevIoctlData, DataRelease>;
ClientData resolve(UMockdevIoctlData* data, std::size_t offset, std::size_t bytes);

}  // namespace echofuse::sim
