#pragma once

#include <string>
#include <utility>
#include <variant>

#include "base/check.h"

namespace portolan {

/// Why an expected failure happened, in words a user can act on: names the file, key or line, the value and what was
/// expected.
struct Error {
  std::string message;
};

/// A value, or the reason why there is none. For failures that are part of normal work; a bug is a PORTOLAN_CHECK
/// instead.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}      // NOLINT: implicit on purpose, `return value;`
  Result(Error error) : state_(std::move(error)) {}  // NOLINT: implicit on purpose, `return Error{...};`

  bool ok() const { return std::holds_alternative<T>(state_); }
  explicit operator bool() const { return ok(); }

  const T& value() const& {
    PORTOLAN_CHECK(ok()) << "value() of a failed Result: " << error_message();
    return std::get<T>(state_);
  }
  T& value() & {
    PORTOLAN_CHECK(ok()) << "value() of a failed Result: " << error_message();
    return std::get<T>(state_);
  }
  T&& value() && {
    PORTOLAN_CHECK(ok()) << "value() of a failed Result: " << error_message();
    return std::get<T>(std::move(state_));
  }
  const T& operator*() const& { return value(); }
  T& operator*() & { return value(); }
  const T* operator->() const { return &value(); }
  T* operator->() { return &value(); }

  /// The reason; only of a failed Result.
  const Error& error() const { return std::get<Error>(state_); }

 private:
  std::string error_message() const { return ok() ? std::string() : std::get<Error>(state_).message; }
  std::variant<T, Error> state_;
};

/// Success without a value, or the reason for failure.
struct Ok {};
using Status = Result<Ok>;

}  // namespace portolan
