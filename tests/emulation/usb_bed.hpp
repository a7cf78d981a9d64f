// SPDX-License-Identifier: MIT
// Devices below the kernel's usbfs and hidraw interfaces, for unmodified programs. umockdev answers
// their system calls and provides a separate sysfs. A program uses it if it was started with
// environment(); this process must have called enter().
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
  // Restarts this program under umockdev's preload library, once. Call it first in main().
  static void enter(char** argv);

  // Only one per process (limit of umockdev). Throws Error(failed).
  UsbBed();
  ~UsbBed();
  UsbBed(const UsbBed&) = delete;
  UsbBed& operator=(const UsbBed&) = delete;

  // Returns the environment for programs that use the devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  const std::string& root() const { return root_; }
  UMockdevTestbed* testbed() const { return testbed_; }

 private:
  UMockdevTestbed* testbed_;
  std::string root_;
};

// Node in /dev with system calls answered by a simulated device. It has a FIFO behind it, so that
// poll() works.
// Threading: created, plugged and unplugged on one thread; on_ functions run on umockdev's thread.
class BedNode {
 public:
  struct Answer {
    long result;    // return value of the system call
    int error = 0;  // errno if the result is -1
  };
  static Answer fail(int error) { return {-1, error}; }
  // Identifies the client that opened the node; never dereferenced.
  using Client = const void*;

  virtual ~BedNode();
  BedNode(const BedNode&) = delete;
  BedNode& operator=(const BedNode&) = delete;

  void plug();
  void unplug();

 protected:
  // `description` is umockdev's text (P: E: A: H: L: lines, no N:). `folders` are its devices below
  // /sys, parents first.
  BedNode(UsbBed& bed, std::string node, std::string description, std::vector<std::string> folders);
  // Stops all answers; call it first in the destructor of the derived class.
  void detach();

  // on_plug: after creating the FIFO, before announcing the device. on_unplug: after removing the
  // device, before announcing it.
  virtual void on_plug(int fifo) = 0;
  virtual void on_unplug() = 0;
  virtual Answer on_ioctl(Client client, unsigned long request, UMockdevIoctlData* argument) = 0;
  // Without a value the FIFO answers.
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

// Client memory behind a system call's argument: `bytes` from `offset`, or from the pointer stored
// there. Null if the client is gone. Released at the end of the scope; writes reach the client with
// the answer.
struct DataRelease {
  void operator()(UMockdevIoctlData* data) const;
};
using ClientData = std::unique_ptr<UMockdevIoctlData, DataRelease>;
ClientData resolve(UMockdevIoctlData* data, std::size_t offset, std::size_t bytes);

}  // namespace echofuse::sim
