#pragma once

#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/files/file_lock.h"

namespace raysfm::app {

// Another run of this program, in a group of its own, so that what a terminal sends does not reach it. It is
// asked to end when this program ends in whatever way.
struct ChildProcess {
  // Starts it in `folder`, what it prints into the file `log`. It holds `lock` too: where this program is
  // killed, it may still be about to write what it has. Errors: internal, no process can be started.
  static Result<pid_t> start(const std::vector<std::string>& arguments, const std::filesystem::path& folder,
                             const std::filesystem::path& log, const FileLock& lock);
};

// How a process ended.
struct ChildEnd {
  pid_t process = -1;  // -1: none has
  int exit_code = 0;   // 128 and the signal where one ended it
  std::string signal;  // its name; empty: it ended by itself
};

// The next child that has ended, waiting for at most `milliseconds`.
ChildEnd next_child_end(int milliseconds);

}  // namespace raysfm::app
