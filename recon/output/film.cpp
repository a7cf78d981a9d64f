// SPDX-License-Identifier: MIT
#include "recon/output/film.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <csignal>

#include "drivers/core/exit_code.hpp"
#include "drivers/core/program.hpp"

namespace echofuse::recon {

Film::~Film() {
  if (input_ >= 0) stop();
}

void Film::start(const chart::Raster& first) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    throw Error(ExitCode::failed, path_ + ": no pipe to ffmpeg");
  std::signal(SIGPIPE, SIG_IGN);  // that it is gone is told by write()
  const std::string size = std::to_string(first.columns) + "x" + std::to_string(first.rows);
  std::vector<std::string> words{
      "ffmpeg",   "-v",    "error", "-y", "-f", "rawvideo",
      "-pix_fmt", "rgb24", "-s",    size, "-r", std::to_string(film_frames_per_s),
      "-i",       "-"};
  file_.emplace(path_);
  if (path_.ends_with(".gif"))
    words.insert(words.end(), {"-f", "gif"});
  else
    words.insert(words.end(), {"-pix_fmt", "yuv420p", "-f", "mp4"});
  words.push_back(file_->path());
  const auto program = start_program(words, {.folder = {}, .input = ends[0]});
  ::close(ends[0]);
  input_ = ends[1];
  program_ = program ? *program : 0;
}

void Film::add(const chart::Raster& picture) {
  if (input_ < 0) start(picture);
  for (std::size_t done = 0; done < picture.rgb.size();) {
    const ssize_t n = ::write(input_, picture.rgb.data() + done, picture.rgb.size() - done);
    if (n <= 0) return close();  // it is gone: its exit code tells
    done += static_cast<std::size_t>(n);
  }
}

int Film::stop() {
  ::close(input_);
  input_ = -1;
  return program_ > 0 ? wait_for_program(program_) : -1;
}

void Film::close() {
  if (input_ < 0) return;
  if (stop() != 0) throw Error(ExitCode::failed, path_ + ": ffmpeg made no film (Debian: ffmpeg)");
  file_->publish();
}

}  // namespace echofuse::recon
