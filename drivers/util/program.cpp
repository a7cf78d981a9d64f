// SPDX-License-Identifier: MIT
#include "drivers/util/program.hpp"

#include <fcntl.h>
#include <grp.h>
#include <pwd.h>
#include <sched.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <sstream>
#include <string_view>
#include <thread>

#include "drivers/util/printable.hpp"

namespace echofuse {

std::filesystem::path program_folder() {
  std::error_code none;
  return std::filesystem::read_symlink("/proc/self/exe", none).parent_path();
}

std::filesystem::path data_folder() { return program_folder().parent_path() / "share/echofuse"; }

std::filesystem::path here_or_installed(const std::filesystem::path& name,
                                        const std::filesystem::path& folder) {
  std::error_code none;
  if (!name.empty() && !std::filesystem::exists(folder / name, none))
    for (const auto& installed : {data_folder(), data_folder() / "radar"})
      if (std::filesystem::exists(installed / name, none)) return installed / name;
  return folder / name;
}

unsigned usable_cores() {
  cpu_set_t cores;
  if (::sched_getaffinity(0, sizeof cores, &cores) != 0)
    return std::max(1u, std::thread::hardware_concurrency());
  return static_cast<unsigned>(CPU_COUNT(&cores));
}

std::string instruction_set() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512vl") ? "AVX-512"
         : __builtin_cpu_supports("avx2")   ? "AVX2"
         : __builtin_cpu_supports("avx")    ? "AVX"
                                            : "SSE";
#elif defined(__aarch64__)
  return "NEON";
#else
  return "no SIMD";
#endif
}

std::string permission_hint(const std::string& node) {
  constexpr mode_t group_access = S_IRGRP | S_IWGRP;
  struct stat file {};
  if (::stat(node.c_str(), &file) == 0 && (file.st_mode & group_access) == group_access &&
      file.st_gid != 0)
    if (const group* owner = ::getgrgid(file.st_gid))
      return std::string("join the group ") + owner->gr_name + " and log in again";
  return "install config/70-echofuse.rules";
}

std::string machine_name() {
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

std::string login_name() {
  const char* caller = ::getuid() == 0 ? std::getenv("SUDO_USER") : nullptr;
  if (caller && *caller) return caller;
  const passwd* user = ::getpwuid(::geteuid());
  return user ? user->pw_name : std::to_string(::geteuid());
}

std::string sibling_program(const std::string& name) {
  std::error_code none;
  const auto sibling = program_folder() / name;
  return std::filesystem::exists(sibling, none) ? sibling.string() : name;
}

std::string fault_of_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(name.find('/') == name.npos && path ? path : "");
  const auto executable = [](const std::filesystem::path& file) {
    std::error_code none;
    return std::filesystem::is_regular_file(file, none) && ::access(file.c_str(), X_OK) == 0;
  };
  for (std::string folder; std::getline(folders, folder, ':');)
    if (executable(std::filesystem::path(folder) / name)) return {};
  if (name.find('/') != name.npos && executable(name)) return {};
  return printable(name) + ": not found, or not executable by this user";
}

Result<pid_t> start_program(const std::vector<std::string>& words, const ProgramOptions& options) {
  const auto pointers = [](const std::vector<std::string>& texts) {
    std::vector<char*> out;
    for (const auto& text : texts) out.push_back(const_cast<char*>(text.c_str()));
    return out;
  };
  std::vector<char*> arguments = pointers(words), environment = pointers(options.environment);
  arguments.push_back(nullptr);
  for (char** inherited = environ; *inherited; ++inherited) {
    const std::string_view variable = *inherited, name = variable.substr(0, variable.find('=') + 1);
    if (std::ranges::none_of(options.environment, [&](auto& own) { return own.starts_with(name); }))
      environment.push_back(*inherited);
  }
  environment.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  if (options.output != STDOUT_FILENO)
    ::posix_spawn_file_actions_adddup2(&actions, options.output, STDOUT_FILENO);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  if (options.background) {
    ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    ::posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  }
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  if (!options.folder.empty())
    ::posix_spawn_file_actions_addchdir_np(&actions, options.folder.c_str());
  pid_t program = 0;
  const int error = ::posix_spawnp(&program, arguments[0], &actions, &attributes, arguments.data(),
                                   environment.data());
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return Failure{{error, std::generic_category()}, words[0] + ": cannot start"};
  return program;
}

int wait_for_program(pid_t program) {
  int status = 0;
  while (::waitpid(program, &status, 0) < 0)
    if (errno != EINTR) return -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace echofuse
