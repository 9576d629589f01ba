#include "base/check.h"

namespace portolan::internal {

CheckMessage::CheckMessage(const char* file, int line, const char* condition) {
  text_ << file << ":" << line << ": check failed: " << condition << " ";
}

CheckMessage::~CheckMessage() noexcept(false) {
  throw CheckFailure(text_.str());
}

}  // namespace portolan::internal
