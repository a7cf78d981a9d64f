// SPDX-License-Identifier: MIT
// Emulated devices below the kernel's interfaces usbfs and hidraw, for unmodified programs.
// umockdev answers the system calls and provides a separate sysfs. A program uses the emulated
// devices if it was started with environment(). The process that emulates the devices must have
// called enter().
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
  // Restarts this program once with umockdev's preload library. Must be the first call in main().
  static void enter(char** argv);

  // Throws Error(failed). Only one testbed can exist per process, because of a limit in umockdev.
  UsbBed();
  ~UsbBed();
  UsbBed(const UsbBed&) = delete;
  UsbBed& operator=(const UsbBed&) = delete;

  // Returns the environment variables that a program needs to use the emulated devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  const std::string& root() const { return root_; }
  UMockdevTestbed* testbed() const { return testbed_; }

 private:
  UMockdevTestbed* testbed_;
  std::string root_;
};

// Return lines of a umockdev device description.
std::string lines(const char* start, const std::vector<std::string>& texts, const char* end = "\n");
inline std::string attributes(const std::vector<std::string>& texts) {
  return lines("A: ", texts, "\\n\n");
}

// Node in /dev. A simulated device answers the system calls made on this node. A FIFO behind the
// node makes poll() work. The owner must create, plug and unplug the node on a single thread. The
// on_ functions are called on umockdev's thread.
class BedNode {
 public:
  struct Answer {
    long result;    // return value of the system call
    int error = 0;  // value of errno if `result` is -1
  };
  static Answer fail(int error) { return {-1, error}; }
  // Identifies the client that opened the node. The pointer is never dereferenced.
  using Client = const void*;

  virtual ~BedNode();
  BedNode(const BedNode&) = delete;
  BedNode& operator=(const BedNode&) = delete;

  void plug();
  void unplug();

 protected:
  // `description` contains the P:, E:, A:, H: and L: lines of a umockdev device description, but no
  // N: line. `folders` lists the device's folders in /sys, with parent folders first.
  BedNode(UsbBed& bed, std::string node, std::string description, std::vector<std::string> folders);
  // Ends all callbacks. Must be the first call in the destructor of every derived class.
  void detach();

  // on_plug() is called after the FIFO is created and before the device is announced. on_unplug()
  // is called after the device is removed and before the removal is announced.
  virtual void on_plug(int fifo) = 0;
  virtual void on_unplug() = 0;
  virtual Answer on_ioctl(Client client, unsigned long request, UMockdevIoctlData* argument) = 0;
  // Returns the result of read(), or nullopt if the FIFO is to answer the call.
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

// Releases the data when the unique_ptr is destroyed.
struct DataRelease {
  void operator()(UMockdevIoctlData* data) const;
};
using ClientData = std::unique_ptr<UMockdevIoctlData, DataRelease>;
// Follows the pointer stored at `offset` in `data` and returns `bytes` bytes of the client's
// memory, or null if the client has ended. Changes to these bytes are sent to the client with the
// answer.
ClientData resolve(UMockdevIoctlData* data, std::size_t offset, std::size_t bytes);

}  // namespace echofuse::sim
