#include "dataset/media_library.h"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string>

namespace portolan {
namespace {

std::string FindMediaLibrary() {
  if (const char* path = std::getenv("PORTOLAN_MEDIA"); path != nullptr && *path != '\0') return path;
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto installed =
      (program.parent_path() / ".." / "lib" / "portolan" / "libportolan_media.so").lexically_normal();
  return std::filesystem::exists(installed, error) ? installed.string() : PORTOLAN_MEDIA_AS_BUILT;
}

}  // namespace

Result<const MediaModule*> LoadMediaModule() {
  static std::mutex mutex;
  static const MediaModule* module = nullptr;
  const std::lock_guard<std::mutex> lock(mutex);
  if (module != nullptr) return module;
  const std::string path = FindMediaLibrary();
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) return Error{std::string("codecs of OpenCV: ") + dlerror()};
  const auto get = reinterpret_cast<const MediaModule* (*)()>(dlsym(library, kMediaModuleSymbol));
  if (get == nullptr) {
    dlclose(library);
    return Error{path + " is no library of codecs: it lacks " + kMediaModuleSymbol};
  }
  module = get();  // and stays loaded: what it opened may live as long as the process
  return module;
}

}  // namespace portolan
