// SPDX-License-Identifier: MIT
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/write.hpp>
#include <cmath>
#include <deque>
#include <list>

#include "acquire/measurement/depth_map.hpp"
#include "sim/devices/depth_wire.hpp"
#include "sim/devices/fault_injector.hpp"
#include "sim/sensors/depth_camera.hpp"

namespace echofuse::sim {
namespace {

using Local = boost::asio::local::stream_protocol;
using ErrorCode = boost::system::error_code;

class DepthFeed final : public Device {
 public:
  DepthFeed(port::SystemLoop& loop, ScenePlayer& player, const DepthOptions& options)
      : player_(player),
        options_(options),
        columns_(record::depth_x_axis(options.width, options.half_tangent_x)),
        rows_(record::depth_y_axis(options.height, options.half_tangent_y)),
        acceptor_(loop.io(), Local::endpoint(options.socket_path)),
        timer_(loop),
        next_(loop.now()),
        injector_(loop, player, "depth", options.plan, options.seed, [this] { poll(); }) {
    accept();
    wait();
  }

  void stop() override {
    stopping_ = true;
    timer_.cancel();
    injector_.stop();
    acceptor_.close();
    for (auto& viewer : viewers_) viewer.socket.close();
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"viewers", all_viewers_}, {"frames", frames_}, {"frames_skipped", skipped_}};
  }

 private:
  // A connected OpenNI2 driver module. Several modules may be connected, because each process that
  // uses OpenNI2 loads its own module.
  struct FeedClient {
    explicit FeedClient(Local::socket s) : socket(std::move(s)) {}
    Local::socket socket;
    Bytes out;  // bytes being written; empty if the client can receive the next frame
    std::array<std::uint8_t, 16> unread{};
    bool gone = false;
  };
  using ViewerIterator = std::list<FeedClient>::iterator;
  struct DepthFrameOut {
    DepthHeader header;
    std::vector<std::uint16_t> pixels;
    const char* what;  // log entry written after sending: sent, corrupt or garbage
    HostTime due;
  };

  void accept() {
    acceptor_.async_accept([this](const ErrorCode& error, Local::socket socket) {
      if (stopping_ || !acceptor_.is_open()) return;
      if (!error) {
        const ViewerIterator viewer = viewers_.emplace(viewers_.end(), std::move(socket));
        ++all_viewers_;
        watch(viewer);
        put(viewer->out, header());
        write(viewer, {}, "greeted");
      }
      accept();
    });
  }

  void watch(ViewerIterator viewer) {
    viewer->socket.async_read_some(boost::asio::buffer(viewer->unread),
                                   [this, viewer](const ErrorCode& error, std::size_t) {
                                     if (!error) return watch(viewer);
                                     viewer->socket.close();
                                     viewer->gone = true;
                                     if (viewer->out.empty()) viewers_.erase(viewer);
                                   });
  }

  void write(ViewerIterator viewer, const DepthHeader& frame, const char* what) {
    const auto written = [this, viewer, begun = injector_.now(), index = frame.frame_index, what](
                             const ErrorCode& error, std::size_t) {
      viewer->out.clear();
      if (!error && index > 0) ++frames_;
      if (index > 0) log(begun, error ? "cut" : what, index);
      if (viewer->gone) viewers_.erase(viewer);
    };
    boost::asio::async_write(viewer->socket, boost::asio::buffer(viewer->out), written);
  }

  void log(HostTime begun, const char* what, std::uint32_t index) {
    injector_.log(begun, what, {{"frame", index}});
  }

  // Sends frames that are due, and starts or ends an unplug fault. While the camera is unplugged,
  // its socket is removed, and connected clients receive an end of file.
  void poll() {
    if (stopping_) return;
    send_due();
    const bool plugged = !injector_.active(FaultKind::unplug);
    if (plugged == acceptor_.is_open()) return;
    ::unlink(options_.socket_path.c_str());
    if (plugged) {
      acceptor_ = Local::acceptor(acceptor_.get_executor(), Local::endpoint(options_.socket_path));
      return accept();
    }
    acceptor_.close();
    for (auto& viewer : viewers_) viewer.socket.shutdown(Local::socket::shutdown_both, ignored_);
  }

  void wait() {
    next_ += from_seconds(1 / options_.fps);
    timer_.at(next_, [this] {
      frame();
      wait();
    });
  }

  DepthHeader header() const {
    DepthHeader h;
    h.width = options_.width;
    h.height = options_.height;
    h.fps = static_cast<std::uint32_t>(std::lround(options_.fps));
    h.horizontal_fov_rad = static_cast<float>(2 * std::atan(options_.half_tangent_x));
    h.vertical_fov_rad = static_cast<float>(2 * std::atan(options_.half_tangent_y));
    return h;
  }

  void frame() {
    ++frame_index_;
    if (viewers_.empty()) return log(injector_.now(), "unseen", frame_index_);
    if (injector_.triggers(FaultKind::drop)) return log(injector_.now(), "dropped", frame_index_);
    if (injector_.active(FaultKind::stall)) return log(injector_.now(), "stalled", frame_index_);
    const double now_s = player_.now_s();
    DepthHeader h = header();
    h.frame_index = frame_index_;
    h.time_us =
        static_cast<std::uint64_t>(std::max(0.0, 1e6 * (now_s + injector_.clock_error_s(now_s))));
    h.truncated = injector_.triggers(FaultKind::corrupt);
    if (last_.empty() || !injector_.active(FaultKind::freeze)) last_ = disturbed(picture(now_s));
    DepthFrameOut frame{h, last_, h.truncated ? "corrupt" : "sent", injector_.due()};
    if (injector_.triggers(FaultKind::garbage)) {
      for (auto& mm : frame.pixels) mm = static_cast<std::uint16_t>(injector_.noise());
      frame.what = "garbage";
    }
    frame.header.pixel_bytes =
        static_cast<std::uint32_t>(frame.pixels.size() * sizeof frame.pixels[0]);
    held_.push_back(std::move(frame));
    send_due();
  }

  void send_due() {
    for (; !held_.empty() && held_.front().due <= injector_.now(); held_.pop_front())
      send(held_.front());
  }

  void send(const DepthFrameOut& frame) {
    for (ViewerIterator viewer = viewers_.begin(); viewer != viewers_.end(); ++viewer) {
      if (viewer->gone) continue;
      if (!viewer->out.empty()) {  // the previous frame is still being written
        ++skipped_;
        log(injector_.now(), "skipped", frame.header.frame_index);
        continue;
      }
      put(viewer->out, frame.header);
      const ByteView raw = as_bytes(frame.pixels);
      viewer->out.insert(viewer->out.end(), raw.begin(), raw.end());
      write(viewer, frame.header, frame.what);
    }
  }

  std::vector<std::uint16_t> disturbed(std::vector<std::uint16_t> pixels) {
    disturb_depth(pixels, columns_.count, player_.conditions(), rng_);
    return pixels;
  }

  const std::vector<std::uint16_t>& picture(double time_s) {
    const RenderedScene& rendered = player_.at(time_s);
    if (rendered.index != pictured_) {
      pixels_ = render_depth_mm(rendered.scene, columns_, rows_);
      pictured_ = rendered.index;
    }
    return pixels_;
  }

  ScenePlayer& player_;
  DepthOptions options_;
  Axis columns_, rows_;
  Local::acceptor acceptor_;
  port::Timer timer_;
  HostTime next_;
  std::list<FeedClient> viewers_;
  // Depths in mm: of the current scene without camera errors, and of the last frame with camera
  // errors.
  std::vector<std::uint16_t> pixels_, last_;
  std::int64_t pictured_ = -1;
  bool stopping_ = false;
  std::uint32_t frame_index_ = 0;
  std::uint64_t all_viewers_ = 0, frames_ = 0, skipped_ = 0;
  std::deque<DepthFrameOut> held_;        // frames that are not yet due
  Rng rng_ = make_rng(options_.seed, 1);  // random numbers for depth noise and missing pixels
  ErrorCode ignored_;
  FaultInjector injector_;
};

}  // namespace

std::unique_ptr<Device> make_depth_feed(port::SystemLoop& loop, ScenePlayer& player,
                                        const DepthOptions& options) {
  return std::make_unique<DepthFeed>(loop, player, options);
}

}  // namespace echofuse::sim
