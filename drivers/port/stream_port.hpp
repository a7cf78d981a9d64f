// SPDX-License-Identifier: MIT
// Common part of all ports based on Asio streams. Only .cpp files in this folder may include this
// header, because it includes Asio.
#pragma once
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <string>
#include <vector>

#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// Pending operations share ownership of the connection's state, so that their handlers can use it
// after the port is destroyed.
template <class Stream>
class StreamPort : public BytePort {
 public:
  StreamPort(boost::asio::io_context& io, std::string name, std::size_t buffer_bytes)
      : link_(std::make_shared<Link>(io, std::move(name), buffer_bytes)) {}
  ~StreamPort() override { link_->close(); }
  StreamPort(const StreamPort&) = delete;
  StreamPort& operator=(const StreamPort&) = delete;

  void write(ByteView bytes) override {
    if (!link_->open) return;
    link_->waiting.insert(link_->waiting.end(), bytes.begin(), bytes.end());
    if (link_->sending.empty()) send(link_);
  }

 protected:
  struct Link {
    Link(boost::asio::io_context& io, std::string text, std::size_t buffer_bytes)
        : stream(io), name(std::move(text)), buffer(buffer_bytes) {}
    void close() {
      closed = true;
      open = false;
      boost::system::error_code ignored;
      stream.close(ignored);
    }
    void fail(const boost::system::error_code& error, const char* doing) {
      if (closed) return;
      close();
      handlers.gone({error, name + ": " + doing});
    }
    Stream stream;
    std::string name;
    PortHandlers handlers;
    Bytes buffer, waiting, sending;
    bool open = false, closed = false;
  };
  using LinkPtr = std::shared_ptr<Link>;

  static void begin(const LinkPtr& link) {
    if (link->closed) return;
    link->open = true;
    link->handlers.opened();
    if (!link->closed) read(link);
  }

  LinkPtr link_;

 private:
  static void read(const LinkPtr& link) {
    link->stream.async_read_some(boost::asio::buffer(link->buffer),
                                 [link](const boost::system::error_code& error, std::size_t count) {
                                   if (error) return link->fail(error, "read");
                                   if (link->closed) return;
                                   link->handlers.bytes(ByteView(link->buffer).first(count));
                                   if (!link->closed) read(link);
                                 });
  }
  static void send(const LinkPtr& link) {
    std::swap(link->sending, link->waiting);
    boost::asio::async_write(link->stream, boost::asio::buffer(link->sending),
                             [link](const boost::system::error_code& error, std::size_t) {
                               link->sending.clear();
                               if (error) return link->fail(error, "write");
                               if (link->open && !link->waiting.empty()) send(link);
                             });
  }
};

}  // namespace echofuse::port
