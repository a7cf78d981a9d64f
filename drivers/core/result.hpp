// SPDX-License-Identifier: MIT
// Holds a value or a failure, for errors of devices and the operating system at run time.
#pragma once
#include <string>
#include <system_error>
#include <utility>
#include <variant>

namespace echofuse {

struct Failure {
  std::error_code code;
  std::string what;  // action that failed, including the device address or file name

  std::string text() const { return what + ": " + code.message(); }
};

template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}
  Result(Failure failure) : state_(std::move(failure)) {}

  explicit operator bool() const { return state_.index() == 0; }
  T& operator*() { return std::get<0>(state_); }
  const T& operator*() const { return std::get<0>(state_); }
  T* operator->() { return &std::get<0>(state_); }
  const T* operator->() const { return &std::get<0>(state_); }
  const Failure& failure() const { return std::get<1>(state_); }

 private:
  std::variant<T, Failure> state_;
};

}  // namespace echofuse
