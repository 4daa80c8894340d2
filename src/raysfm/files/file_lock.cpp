#include "raysfm/files/file_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace raysfm {
namespace {

// Whether the name still leads to the open file: its last owner may have removed it meanwhile.
bool is_still_there(const std::string& name, int file) {
  struct stat named, opened;
  return ::stat(name.c_str(), &named) == 0 && ::fstat(file, &opened) == 0 && named.st_dev == opened.st_dev &&
         named.st_ino == opened.st_ino;
}

}  // namespace

Result<FileLock> FileLock::take(const std::filesystem::path& path) {
  std::error_code failure;
  const std::filesystem::path end = std::filesystem::weakly_canonical(path, failure);
  const std::string name = (failure ? path : end).string() + ".lock";
  for (;;) {
    const int file = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (file < 0) {
      return bad_input(fmt::format("{}: cannot be held: {}: {}", path.string(), name, std::strerror(errno)));
    }
    const int cause = ::flock(file, LOCK_EX | LOCK_NB) == 0 ? 0 : errno;
    if (cause == 0 && is_still_there(name, file)) return FileLock(name, file);
    ::close(file);
    if (cause == EWOULDBLOCK) {
      return bad_input(fmt::format("{}: held by another run; allowed: one at a time", path.string()));
    }
    if (cause != 0)
      return bad_input(fmt::format("{}: cannot be held: {}", path.string(), std::strerror(cause)));
  }
}

FileLock::FileLock(FileLock&& other) noexcept
    : name_(std::move(other.name_)), file_(std::exchange(other.file_, -1)) {}

FileLock::~FileLock() {
  if (file_ < 0) return;
  ::unlink(name_.c_str());
  ::close(file_);
}

}  // namespace raysfm
