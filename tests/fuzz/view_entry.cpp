// SPDX-License-Identifier: MIT
// Input: data from a client of echofuse-view. The first byte selects whether an HTTP request or a
// WebSocket text message follows.
#include "fuzz.hpp"
#include "recon/live/http.hpp"
#include "recon/live/message.hpp"

using namespace echofuse::view;

namespace {

void take_text(std::string_view text) {
  const Request request = parse_request(text);
  if (const auto* mark = std::get_if<Mark>(&request))
    require(mark->text.size() <= max_text_bytes && fuzz::is_printable(mark->text),
            "a mark is a short line");
  if (const auto* record = std::get_if<ShowRecord>(&request))
    require(record->index >= 0, "a record has an index");
  if (const auto* sum = std::get_if<ShowSum>(&request))
    require(sum->records >= 0 && sum->records <= std::int64_t{max_summed}, "a sum is bounded");
  if (const auto* sheet = std::get_if<ShowSheet>(&request))
    require(sheet->first >= 0 && sheet->first <= sheet->last, "a page of records is in order");
}

void take_http(std::string_view bytes, bool everybody, bool many) {
  http::request_parser<http::empty_body> parser;
  parser.header_limit(max_header_bytes);
  parser.body_limit(std::uint64_t{0});
  parser.eager(true);
  boost::system::error_code error;
  parser.put(boost::asio::buffer(bytes.data(), bytes.size()), error);
  if (error || !parser.is_done()) return;
  Access access;
  access.token = "0123456789abcdef0123456789abcdef";
  access.loopback = !everybody, access.needs_token = everybody, access.many = many;
  const HttpRequest request = parser.release();
  const bool knows = bytes.find(access.token) != bytes.npos;
  bool asked = false;
  const HttpResponse response = respond(request, caller_of(request, access, false), [&] {
    asked = true;
    return std::string("x 1\n");
  });
  const auto host = request[http::field::host];
  require(access.accepts_host({host.data(), host.size()}) ||
              http::to_status_class(response.result()) == http::status_class::client_error,
          "a foreign host name is refused");
  require(knows || !everybody || !asked, "no metrics without the token");
  const Caller caller = caller_of(request, access, true);
  require(knows || !caller.may_write, "writing needs the token");
  require(knows || !everybody || caller.refusal != http::status::ok,
          "remote reading needs the token");
  require(response["Content-Security-Policy"].find('\n') == boost::string_view::npos,
          "the answer contains no header of the client");
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const std::string_view text = text_of(input.subspan(1));
  if (input[0] % 4 == 0)
    take_text(text);
  else
    take_http(text, input[0] % 2 == 0, input[0] % 8 < 4);
}
