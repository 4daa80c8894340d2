#include "raysfm/files/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

namespace raysfm {
namespace {

namespace fs = std::filesystem;

Error cannot_write(const fs::path& path, int cause) {
  return bad_input(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(cause)));
}

std::string temporary_name(const fs::path& path) {
  static std::atomic<unsigned> counter{0};
  return fmt::format("{}.{}.{}.tmp", path.string(), getpid(), counter++);
}

// Zero or the cause of failure.
int write_all(int file, const ContentParts& next_part) {
  for (std::string_view part = next_part(); !part.empty(); part = next_part()) {
    while (!part.empty()) {
      const ssize_t written = ::write(file, part.data(), part.size());
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) return errno;
      part.remove_prefix(written);
    }
  }
  return 0;
}

int flush(int file) {
  return ::fsync(file) == 0 ? 0 : errno;
}

// The new name survives a loss of power only once its folder is flushed too. Not every file system can; that
// leaves the file complete all the same.
void flush_folder(const fs::path& path) {
  const fs::path folder = path.has_parent_path() ? path.parent_path() : ".";
  const int file = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) return;
  ::fsync(file);
  ::close(file);
}

// Where the links end, whether or not something is there.
Result<fs::path> behind_links(fs::path path) {
  constexpr int kMostLinks = 40;
  std::error_code failure;
  for (int i = 0; i < kMostLinks; ++i) {
    if (!fs::is_symlink(path, failure)) return path;
    path = path.parent_path() / fs::read_symlink(path, failure);
    if (failure) return cannot_write(path, failure.value());
  }
  return cannot_write(path, ELOOP);
}

// A device, a pipe or a socket.
bool is_stream(const fs::path& path) {
  std::error_code missing;
  const fs::file_status status = fs::status(path, missing);
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

Result<void> write_stream(const fs::path& path, const ContentParts& content) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (file < 0) return cannot_write(path, errno);
  int cause = write_all(file, content);
  if (::close(file) != 0 && cause == 0) cause = errno;
  return cause == 0 ? Result<void>() : cannot_write(path, cause);
}

// Whatever `fill` puts into the open file, which it is also given the name of, comes to stand at `path`,
// behind whose links nothing is.
template <typename Fill>
Result<void> replace_end(const fs::path& path, const Fill& fill) {
  const std::string temporary = temporary_name(path);
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) return cannot_write(path, errno);

  Result<void> done = fill(file, temporary);
  int cause = done ? flush(file) : 0;
  if (::close(file) != 0 && cause == 0) cause = errno;
  if (done && cause == 0 && std::rename(temporary.c_str(), path.c_str()) != 0) cause = errno;
  if (done && cause != 0) done = cannot_write(path, cause);
  if (done) {
    flush_folder(path);
  } else {
    ::unlink(temporary.c_str());
  }
  return done;
}

}  // namespace

Result<void> write_file(const fs::path& path, const ContentParts& next_part) {
  // First, since the links of /dev/stdout lead to no name.
  if (is_stream(path)) return write_stream(path, next_part);
  const Result<fs::path> end = behind_links(path);
  if (!end) return end.error();
  return replace_end(*end, [&](int file, const std::string&) {
    const int cause = write_all(file, next_part);
    return cause == 0 ? Result<void>() : cannot_write(*end, cause);
  });
}

Result<void> replace_file(const fs::path& path, const FileFiller& fill) {
  if (is_stream(path)) return bad_input(fmt::format("{}: not a file", path.string()));
  const Result<fs::path> end = behind_links(path);
  if (!end) return end.error();
  return replace_end(*end, [&](int, const std::string& temporary) { return fill(temporary); });
}

Result<void> write_file(const fs::path& path, std::string_view content) {
  return write_file(path, [&] { return std::exchange(content, {}); });
}

Result<void> create_folder(const fs::path& folder) {
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (!failure && !fs::is_directory(folder)) failure = std::make_error_code(std::errc::not_a_directory);
  if (!failure) return {};
  return bad_input(fmt::format("{}: folder cannot be created: {}", folder.string(), failure.message()));
}

Result<void> check_not_input(const std::string& flag, const fs::path& path,
                             std::span<const std::string> inputs) {
  for (const std::string& input : inputs) {
    std::error_code missing;
    if (is_stream(path) || !fs::equivalent(path, input, missing)) continue;
    return bad_input(fmt::format("{}: {} would overwrite the input {}", flag, path.string(), input));
  }
  return {};
}

}  // namespace raysfm
