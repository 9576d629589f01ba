#pragma once

#include <sstream>
#include <stdexcept>

namespace portolan {

/// Thrown when a check fails: a bug in Portolan, not a condition of its input.
class CheckFailure : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

namespace internal {

/// Collects the message of a failed check and throws at the end of the statement.
class CheckMessage {
 public:
  CheckMessage(const char* file, int line, const char* condition);
  [[noreturn]] ~CheckMessage() noexcept(false);
  template <class T>
  CheckMessage& operator<<(const T& value) {
    text_ << value;
    return *this;
  }

 private:
  std::ostringstream text_;
};

struct CheckVoidify {
  void operator&(const CheckMessage&) {}
};

}  // namespace internal
}  // namespace portolan

/// Throws CheckFailure with the condition and what is streamed in, when the condition is false.
#define PORTOLAN_CHECK(condition) \
  (condition)                     \
      ? (void)0                   \
      : ::portolan::internal::CheckVoidify() & ::portolan::internal::CheckMessage(__FILE__, __LINE__, #condition)
