#include "raysfm/io/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>

namespace raysfm {
namespace {

Error cannot_write(const std::filesystem::path& path, int cause) {
  return bad_input(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(cause)));
}

std::string temporary_name(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  return fmt::format("{}.{}.{}.tmp", path.string(), getpid(), counter++);
}

// Zero or the cause of failure.
int write_all(int file, std::string_view content) {
  while (!content.empty()) {
    const ssize_t written = ::write(file, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    content.remove_prefix(written);
  }
  return ::fsync(file) == 0 ? 0 : errno;
}

// The new name survives a loss of power only once its folder is flushed too. Not every file system can; that
// leaves the file complete all the same.
void flush_folder(const std::filesystem::path& path) {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  const int file = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) return;
  ::fsync(file);
  ::close(file);
}

}  // namespace

Result<void> write_file(const std::filesystem::path& path, std::string_view content) {
  const std::string temporary = temporary_name(path);
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) return cannot_write(path, errno);

  int cause = write_all(file, content);
  if (::close(file) != 0 && cause == 0) cause = errno;
  if (cause == 0 && std::rename(temporary.c_str(), path.c_str()) != 0) cause = errno;
  if (cause != 0) {
    ::unlink(temporary.c_str());
    return cannot_write(path, cause);
  }
  flush_folder(path);
  return {};
}

}  // namespace raysfm
