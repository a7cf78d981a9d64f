// SPDX-License-Identifier: MIT
#include "tests/emulation/usb_bed.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <umockdev.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>

#include "drivers/util/exit_code.hpp"

namespace echofuse::sim {
namespace {

constexpr char preload[] = "libumockdev-preload.so.0";

[[noreturn]] void refuse(const std::string& doing, GError* error) {
  const std::string why = error ? error->message : std::strerror(errno);
  g_clear_error(&error);
  throw Error(ExitCode::failed, "USB emulation: " + doing + ": " + why);
}

}  // namespace

void UsbBed::enter(char** argv) {
  const char* now = std::getenv("LD_PRELOAD");
  if (now && std::strstr(now, preload)) return;
  const std::string all = now && *now ? std::string(now) + ":" + preload : preload;
  ::setenv("LD_PRELOAD", all.c_str(), 1);
  // The sanitizer runtime refuses to start unless it comes first in LD_PRELOAD. This check is
  // disabled, because umockdev does not depend on the order.
  const char* options = std::getenv("ASAN_OPTIONS");
  const std::string asan = (options ? std::string(options) + ":" : "") + "verify_asan_link_order=0";
  ::setenv("ASAN_OPTIONS", asan.c_str(), 1);
  ::execv("/proc/self/exe", argv);
  throw Error(ExitCode::failed, std::string("cannot restart the program: ") + std::strerror(errno));
}

UsbBed::UsbBed() : testbed_(umockdev_testbed_new()) {
  char* root = umockdev_testbed_get_root_dir(testbed_);
  root_ = root;
  g_free(root);
}

UsbBed::~UsbBed() { g_object_unref(testbed_); }

std::vector<std::pair<std::string, std::string>> UsbBed::environment() const {
  return {{"LD_PRELOAD", preload}, {"UMOCKDEV_DIR", root_}};
}

std::string lines(const char* start, const std::vector<std::string>& texts, const char* end) {
  std::string all;
  for (const std::string& text : texts) all += start + text + end;
  return all;
}

// State used by the callbacks, which may run on umockdev's thread after the node has been
// destroyed. Every signal handler and every client holds a reference to this state.
struct BedNode::Callbacks {
  using Share = std::shared_ptr<Callbacks>;
  std::mutex mutex;
  BedNode* owner = nullptr;  // null after detach()

  static gboolean ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, Share* self) {
    return answer(client, self, [&](BedNode& node, UMockdevIoctlData* argument) {
      return node.on_ioctl(client, umockdev_ioctl_client_get_request(client), argument);
    });
  }
  static gboolean read(UMockdevIoctlBase*, UMockdevIoctlClient* client, Share* self) {
    return answer(client, self, [](BedNode& node, auto*) { return node.on_read(); });
  }
  static gboolean write(UMockdevIoctlBase*, UMockdevIoctlClient* client, Share* self) {
    return answer(client, self, [](BedNode& node, UMockdevIoctlData* bytes) {
      return node.on_write({bytes->data, static_cast<std::size_t>(bytes->data_len)});
    });
  }
  static void connected(UMockdevIoctlBase*, UMockdevIoctlClient* client, Share* self) {
    g_object_weak_ref(G_OBJECT(client), gone, new Share(*self));
    const std::lock_guard lock((*self)->mutex);
    if ((*self)->owner) (*self)->owner->on_client();
  }
  // Called when umockdev releases the client. In umockdev 0.17.16, no other signal indicates that a
  // client has closed the node or exited.
  static void gone(gpointer data, GObject* client) {
    const std::unique_ptr<Share> self(static_cast<Share*>(data));
    const std::lock_guard lock((*self)->mutex);
    if ((*self)->owner) (*self)->owner->on_client_gone(client);
  }
  static void release(gpointer data, GClosure*) { delete static_cast<Share*>(data); }

 private:
  template <class Ask>
  static gboolean answer(UMockdevIoctlClient* client, const Share* self, Ask ask) {
    const std::lock_guard lock((*self)->mutex);
    BedNode* node = (*self)->owner;
    std::optional<Answer> a = fail(ENODEV);
    if (node) a = ask(*node, umockdev_ioctl_client_get_arg(client));
    if (a) umockdev_ioctl_client_complete(client, a->result, a->error);
    return a.has_value();
  }
};

BedNode::BedNode(UsbBed& bed, std::string node, std::string description,
                 std::vector<std::string> folders)
    : bed_(bed),
      node_(std::move(node)),
      description_(std::move(description)),
      folders_(std::move(folders)),
      handler_(umockdev_ioctl_base_new()),
      callbacks_(std::make_shared<Callbacks>()) {
  callbacks_->owner = this;
  const auto connect = [this](const char* signal, GCallback callback) {
    g_signal_connect_data(handler_, signal, callback, new Callbacks::Share(callbacks_),
                          Callbacks::release, GConnectFlags{});
  };
  connect("handle-ioctl", G_CALLBACK(Callbacks::ioctl));
  connect("handle-read", G_CALLBACK(Callbacks::read));
  connect("handle-write", G_CALLBACK(Callbacks::write));
  connect("client-connected", G_CALLBACK(Callbacks::connected));
}

BedNode::~BedNode() {
  detach();
  if (attached_) umockdev_testbed_detach_ioctl(bed_.testbed(), node_.c_str(), nullptr);
  g_object_unref(handler_);
  if (fifo_ >= 0) ::close(fifo_);
}

void BedNode::detach() {
  const std::lock_guard lock(callbacks_->mutex);
  callbacks_->owner = nullptr;
}

void BedNode::make_fifo() {
  const std::string path = bed_.root() + node_;
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  ::unlink(path.c_str());
  if (fifo_ >= 0) ::close(fifo_);
  if (::mkfifo(path.c_str(), 0666) != 0) refuse("make " + path, nullptr);
  fifo_ = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (fifo_ < 0) refuse("open " + path, nullptr);
}

// The FIFO must be created first, because adding the device also sends the uevent.
void BedNode::plug() {
  if (std::exchange(plugged_, true)) return;
  make_fifo();
  on_plug(fifo_);
  GError* error = nullptr;
  if (!std::exchange(attached_, true) &&
      !umockdev_testbed_attach_ioctl(bed_.testbed(), node_.c_str(), handler_, &error))
    refuse("attach " + node_, error);
  if (!umockdev_testbed_add_from_string(bed_.testbed(), description_.c_str(), &error))
    refuse("add " + node_, error);
}

void BedNode::unplug() {
  if (!std::exchange(plugged_, false)) return;
  on_unplug();
  umockdev_testbed_uevent(bed_.testbed(), ("/sys" + folders_.back()).c_str(), "remove");
  ::unlink((bed_.root() + node_).c_str());
  for (auto folder = folders_.rbegin(); folder != folders_.rend(); ++folder)
    umockdev_testbed_remove_device(bed_.testbed(), ("/sys" + *folder).c_str());
}

void DataRelease::operator()(UMockdevIoctlData* data) const { umockdev_ioctl_data_unref(data); }

ClientData resolve(UMockdevIoctlData* data, std::size_t offset, std::size_t bytes) {
  return ClientData(umockdev_ioctl_data_resolve(data, offset, bytes, nullptr));
}

}  // namespace echofuse::sim
