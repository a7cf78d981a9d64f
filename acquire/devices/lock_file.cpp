// SPDX-License-Identifier: MIT
#include "acquire/devices/lock_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <thread>
#include <utility>

#include "acquire/record/file_lock.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::string_view head = "echofuse device lock\n";
constexpr int flags = O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
constexpr auto write_time = std::chrono::milliseconds(20);  // between a lock and its holder's name

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw Error(ExitCode::device, "the device lock " + path + ": " + why);
}

// Of a lock that somebody has.
Holder read(int fd) {
  for (int tries = 0;; ++tries) {
    std::array<char, 8192> bytes{};
    const ssize_t got = ::pread(fd, bytes.data(), bytes.size(), 0);
    std::string_view text(bytes.data(), got > 0 ? static_cast<std::size_t>(got) : 0);
    if (text.starts_with(head) && text.ends_with('\n')) {
      text.remove_prefix(head.size());
      const std::size_t end = text.find('\n');
      if (end + 1 < text.size())
        return Holder{printable(std::string(text.substr(0, end))),
                      std::string(text.substr(end + 1, text.size() - end - 2))};
    }
    if (tries == 2) return Holder{"another echofuse-acquire", ""};
    std::this_thread::sleep_for(write_time);
  }
}

}  // namespace

// Debian's /run/lock is everybody's, other systems' is root's.
std::string lock_folder() {
  if (const char* named = std::getenv("ECHOFUSE_LOCKS"); named && *named) return named;
  constexpr const char* usual = "/run/lock";
  struct stat is {};
  const bool shared = ::stat(usual, &is) == 0 && S_ISDIR(is.st_mode) && (is.st_mode & S_IWOTH) != 0;
  return shared ? usual : "/tmp";
}

LockFile::LockFile(const std::string& folder, const std::string& name, const Holder& me)
    : path_(folder + "/" + name) {
  open_file();
  const int error = record::take_lock(fd_);
  if (error == 0) {
    write(me);
    return;
  }
  if (error == EAGAIN) other_ = read(fd_);
  ::close(std::exchange(fd_, -1));
  if (!other_) refuse(path_, std::strerror(error));
}

LockFile::~LockFile() {
  if (fd_ < 0) return;
  [[maybe_unused]] const int emptied = ::ftruncate(fd_, 0);
  ::close(fd_);
}

// Without O_CREAT first: the kernel may refuse it for another user's file in a shared folder.
void LockFile::open_file() {
  fd_ = ::open(path_.c_str(), flags);
  if (fd_ < 0 && errno == ENOENT) {
    fd_ = ::open(path_.c_str(), flags | O_CREAT | O_EXCL, 0666);
    if (fd_ >= 0 && ::fchmod(fd_, 0666) != 0) ::close(std::exchange(fd_, -1));
    if (fd_ < 0 && errno == EEXIST) fd_ = ::open(path_.c_str(), flags);
  }
  if (fd_ < 0)
    refuse(path_, errno == ELOOP ? "is a symbolic link; remove it" : std::strerror(errno));
  struct stat is {};
  std::array<char, head.size()> begin{};
  const bool plain = ::fstat(fd_, &is) == 0 && S_ISREG(is.st_mode) && is.st_nlink <= 1;
  // Its holder may be about to write: what is there yet is how ours begin.
  const ssize_t got = ::pread(fd_, begin.data(), begin.size(), 0);
  if (plain && got >= 0 &&
      head.starts_with(std::string_view(begin.data(), static_cast<std::size_t>(got))))
    return;
  ::close(std::exchange(fd_, -1));
  refuse(path_, "is not a file that echofuse-acquire wrote; remove it");
}

// Without its name, on a full disk say, it is a lock all the same.
void LockFile::write(const Holder& me) const {
  const std::string text = std::string(head) + printable(me.who) + '\n' + me.run + '\n';
  if (::ftruncate(fd_, 0) == 0) [[maybe_unused]]
    const auto written = ::pwrite(fd_, text.data(), text.size(), 0);
}

std::vector<Holder> holders_in(const std::string& folder) {
  std::vector<Holder> out;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with("echofuse-") || !name.ends_with(".lock")) continue;
    const int fd = ::open(entry.path().c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) continue;
    if (record::somebody_has_lock(fd)) out.push_back(read(fd));
    ::close(fd);
  }
  return out;
}

}  // namespace echofuse::acquire
