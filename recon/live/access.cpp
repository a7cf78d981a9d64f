// SPDX-License-Identifier: MIT
#include "recon/live/access.hpp"

#include <arpa/inet.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>

#include "drivers/util/exit_code.hpp"

namespace echofuse::view {
namespace {

bool same_name(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](unsigned char x, unsigned char y) {
    return std::tolower(x) == std::tolower(y);
  });
}

std::string_view name_in(std::string_view host) {
  const std::size_t end = host.starts_with('[') ? host.find(']') + 1 : host.find(':');
  const std::string_view name = host.substr(0, end), rest = host.substr(name.size());
  const bool port = rest.empty() || (rest.size() > 1 && rest.size() <= 6 && rest[0] == ':' &&
                                     rest.find_first_not_of("0123456789", 1) == rest.npos);
  return port && !(host.starts_with('[') && end == 0) ? name : std::string_view{};
}

bool is_loopback(std::string_view name) {
  in_addr address{};
  return same_name(name, "localhost") || name == "[::1]" ||
         (name.starts_with("127.") &&
          ::inet_pton(AF_INET, std::string(name).c_str(), &address) == 1);
}

}  // namespace

bool Access::accepts_host(std::string_view host) const {
  const std::string_view name = name_in(host);
  return !name.empty() && (!loopback || is_loopback(name));
}

bool Access::accepts_origin(std::string_view origin, std::string_view host) const {
  if (origin.empty()) return true;
  for (const std::string_view scheme : {"http://", "https://"})
    if (origin.starts_with(scheme)) return same_name(origin.substr(scheme.size()), host);
  return false;
}

// Compares the tokens in constant time, to prevent timing attacks.
bool Access::is_token(std::string_view given) const {
  if (token.empty() || given.size() != token.size()) return false;
  unsigned differs = 0;
  for (std::size_t i = 0; i < token.size(); ++i)
    differs |= static_cast<unsigned char>(token[i]) ^ static_cast<unsigned char>(given[i]);
  return differs == 0;
}

std::string make_token() {
  std::array<unsigned char, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    throw Error(ExitCode::failed, "cannot make a token: the system returned no random numbers");
  constexpr std::string_view digits = "0123456789abcdef";
  std::string out;
  for (const unsigned char b : bytes) out += {digits[b >> 4], digits[b & 15]};
  return out;
}

Target target_of(std::string_view target) {
  constexpr std::string_view name = "token=";
  const std::size_t mark = std::min(target.find('?'), target.size());
  Target out{target.substr(0, mark), {}};
  std::string_view rest = target.substr(std::min(mark + 1, target.size()));
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('&'), rest.size());
    if (rest.starts_with(name)) out.token = rest.substr(name.size(), end - name.size());
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return out;
}

std::string decoded(std::string_view part) {
  std::string out;
  for (std::size_t i = 0; i < part.size(); ++i) {
    unsigned value = 0;
    const char* digits = part.data() + i + 1;
    const bool coded = part[i] == '%' && i + 2 < part.size() &&
                       std::from_chars(digits, digits + 2, value, 16).ptr == digits + 2;
    out += coded ? static_cast<char>(value) : part[i];
    i += coded ? 2 : 0;
  }
  return out;
}

}  // namespace echofuse::view
