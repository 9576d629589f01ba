#include "vocabulary/vocabulary_storage.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace portolan {

Vocabulary::Storage::~Storage() {
  if (mapping != nullptr) munmap(mapping, mapping_bytes);
}

std::string Vocabulary::Storage::Map(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return std::string("cannot be opened: ") + std::strerror(errno);
  struct stat status {};
  std::string fault;
  if (fstat(file, &status) != 0 || !S_ISREG(status.st_mode)) {
    fault = "is not a regular file";
  } else if (status.st_size == 0) {
    fault = "is empty";
  } else {
    void* address = mmap(nullptr, static_cast<size_t>(status.st_size), PROT_READ, MAP_SHARED | MAP_POPULATE, file, 0);
    if (address == MAP_FAILED) {
      fault = std::string("cannot be mapped into memory: ") + std::strerror(errno);
    } else {
      mapping = address;
      mapping_bytes = static_cast<size_t>(status.st_size);
    }
  }
  close(file);
  return fault;
}

}  // namespace portolan
