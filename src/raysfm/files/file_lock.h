#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"

namespace raysfm {

// Holds a file against other runs that ask for it too, by FILE.lock beside it, which goes with the lock. What
// a run leaves that was killed holds nobody up.
class FileLock {
 public:
  // The file itself need not be there. Errors: bad input, where another run holds it or the lock cannot be
  // made.
  static Result<FileLock> take(const std::filesystem::path& path);
  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&&) = delete;
  ~FileLock();

  // The descriptor that holds it. A process that inherits it open holds the file as long as it runs, whatever
  // becomes of this one.
  int file() const { return file_; }

 private:
  FileLock(std::string name, int file) : name_(std::move(name)), file_(file) {}

  std::string name_;
  int file_;
};

}  // namespace raysfm
