// SPDX-License-Identifier: MIT
#include "recon/live/http.hpp"

namespace echofuse::view {
namespace {

template <class Name>
std::string_view field(const HttpRequest& request, Name name) {
  const auto value = request[name];
  return {value.data(), value.size()};
}

// Returns the host name displayed by the browser. Behind a proxy, this name is in the header
// X-Forwarded-Host.
std::string_view host_of(const HttpRequest& request) {
  const std::string_view forwarded = field(request, "X-Forwarded-Host");
  return forwarded.empty() ? field(request, http::field::host)
                           : forwarded.substr(0, forwarded.find(','));
}

// Returns the Content-Security-Policy. connect-src contains the full address of the WebSocket,
// because some browsers do not apply 'self' to ws: and wss:.
std::string policy(std::string_view host) {
  const std::string name(host.substr(0, host.find_first_of(";, \t")));
  return "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
         "connect-src 'self' ws://" +
         name + " wss://" + name + "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
}

HttpResponse make(const HttpRequest& request, http::status status, std::string_view type,
                  std::string body) {
  HttpResponse out(status, 11);
  out.set(http::field::content_type, std::string(type));
  out.set(http::field::cache_control, "no-store");
  out.set("X-Content-Type-Options", "nosniff");
  out.set("Referrer-Policy", "no-referrer");
  out.set("Cross-Origin-Resource-Policy", "same-origin");
  out.set("X-Frame-Options", "DENY");
  out.keep_alive(false);
  out.content_length(body.size());
  if (request.method() != http::verb::head) out.body() = std::move(body);
  return out;
}

// Extracts the run name from the path of a request, and removes the prefix "/run/NAME" or "/newest"
// from that path.
void choose(Caller& caller) {
  constexpr std::string_view newest = "/newest/", run = "/run/";
  const std::string path = caller.path;
  const std::size_t end = path.starts_with(newest) ? newest.size() - 1
                          : path.starts_with(run)  ? path.find('/', run.size())
                                                   : path.npos;
  if (end == path.npos || end == run.size()) return;
  caller.page = true, caller.path = path.substr(end);
  if (path.starts_with(run)) caller.run = decoded(path.substr(run.size(), end - run.size()));
}

const PageFile* part_of(const Caller& caller) {
  if (caller.path == "/") return page_file(caller.page ? "index.html" : "runs.html");
  return page_file(caller.path.substr(1));
}

}  // namespace

Caller caller_of(const HttpRequest& request, const Access& access, bool socket) {
  const std::string_view host = field(request, http::field::host);
  const auto target = request.target();
  const Target requested = target_of({target.data(), target.size()});
  Caller out;
  out.path = requested.path, out.may_write = access.may_write(requested.token);
  out.page = !access.many;
  if (access.many) choose(out);
  const auto refuse = [&](http::status status, const char* why) {
    out.refusal = status, out.why = why;
    return out;
  };
  if (request.count(http::field::host) != 1 || request.count(http::field::origin) > 1)
    return refuse(http::status::bad_request,
                  "expected exactly one Host header and at most one Origin header");
  if (!access.accepts_host(host))
    return refuse(
        http::status::misdirected_request,
        "unknown host name in the Host header; a proxy must pass it in X-Forwarded-Host instead");
  if (request.method() != http::verb::get && request.method() != http::verb::head)
    return refuse(http::status::method_not_allowed, "expected GET");
  if (!out.path.starts_with('/'))
    return refuse(http::status::bad_request, "expected a path that begins with /");
  const PageFile* part = part_of(out);
  const bool open = part && out.path != "/";  // scripts and styles can be read without a token
  if (!open && !access.accepts_origin(field(request, http::field::origin), host_of(request)))
    return refuse(http::status::forbidden,
                  "cross-origin request: only pages from this server may send requests");
  if (!open && !access.may_read(requested.token))
    return refuse(http::status::unauthorized,
                  "token missing or wrong: open the full address printed by the program");
  const bool list = out.path == "/runs" && !out.page;
  if (!part && !list && out.path != "/live") return refuse(http::status::not_found, "not found");
  if ((out.path == "/live") != socket)
    return refuse(http::status::upgrade_required,
                  "expected a WebSocket upgrade: configure the proxy to forward "
                  "X-Forwarded-Host, Upgrade and Connection");
  return out;
}

HttpResponse respond(const HttpRequest& request, const Caller& caller,
                     const std::function<std::string()>& runs) {
  if (caller.refusal != http::status::ok)
    return make(request, caller.refusal, "text/plain; charset=utf-8", caller.why + "\n");
  if (caller.path == "/runs") return make(request, http::status::ok, "application/json", runs());
  const PageFile& part = *part_of(caller);
  HttpResponse out = make(request, http::status::ok, part.type, std::string(part.contents));
  out.set("Content-Security-Policy", policy(host_of(request)));
  return out;
}

}  // namespace echofuse::view
