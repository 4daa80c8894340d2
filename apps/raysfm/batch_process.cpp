#include "batch_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>

namespace raysfm::app {
namespace {

constexpr int kNoStart = 126;  // exit code of a child that did not become the program

// What happens between fork and exec: calls of the system only.
[[noreturn]] void become(char* const* arguments, const char* folder, int log, int lock, pid_t parent) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_DFL);
  const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
  const bool ready = getppid() == parent && nothing >= 0 && dup2(nothing, STDIN_FILENO) >= 0 &&
                     dup2(log, STDOUT_FILENO) >= 0 && dup2(log, STDERR_FILENO) >= 0 &&
                     fcntl(lock, F_SETFD, 0) == 0 && chdir(folder) == 0;
  if (ready) execv("/proc/self/exe", arguments);
  _exit(kNoStart);
}

}  // namespace

Result<pid_t> ChildProcess::start(const std::vector<std::string>& arguments,
                                  const std::filesystem::path& folder, const std::filesystem::path& log,
                                  const FileLock& lock) {
  std::vector<std::string> words = {"raysfm"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) return bad_input(fmt::format("{}: {}", log.string(), std::strerror(errno)));
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) become(pointers.data(), folder.c_str(), file, lock.file(), parent);
  const int failure = errno;
  close(file);
  if (child < 0) return internal_error(fmt::format("no process can be started: {}", std::strerror(failure)));
  return child;
}

ChildEnd next_child_end(int milliseconds) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point end = Clock::now() + std::chrono::milliseconds(milliseconds);
  for (;;) {
    int status = 0;
    const pid_t process = waitpid(-1, &status, WNOHANG);
    if (process > 0) {
      if (!WIFSIGNALED(status)) return {process, WEXITSTATUS(status), ""};
      return {process, 128 + WTERMSIG(status), strsignal(WTERMSIG(status))};
    }
    if (Clock::now() >= end) return {};
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace raysfm::app
