#include "terminal.h"

#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>

#include "raysfm/scene/worlds.h"

namespace raysfm::app {
namespace {

std::atomic<bool> stop_requested = false;
volatile std::sig_atomic_t received_signal = 0;

// A terminal or a reader that went away says so again and again: what there is is still to be written.
void on_signal(int signal) {
  received_signal = signal;
  stop_requested = true;
  std::signal(signal, signal == SIGHUP || signal == SIGPIPE ? SIG_IGN : SIG_DFL);
}

}  // namespace

std::string counts_text(const Reconstruction& r) {
  return fmt::format("{} of {} frames posed in {} segment{}, {} key frames, {} points, rms {:.2f} px",
                     posed_count(r), r.frames.size(), r.segments.size(), r.segments.size() == 1 ? "" : "s",
                     r.keyframes.size(), r.points.size(), r.rms_reprojection_px);
}

Result<int> printed(const std::string& text) {
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    return bad_input("standard output cannot be written");
  }
  return 0;
}

StopSignals::StopSignals() {
  stop_requested = false;
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  for (const int signal : {SIGHUP, SIGPIPE}) {
    if (std::signal(signal, on_signal) == SIG_IGN) std::signal(signal, SIG_IGN);  // as nohup asks for
  }
}

const std::atomic<bool>* StopSignals::requested() const {
  return &stop_requested;
}

int StopSignals::exit_code() const {
  return 128 + received_signal;
}

ProgressLine::ProgressLine(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}

void ProgressLine::show(const std::string& text) {
  if (quiet_ || text == shown_) return;
  shown_ = text;
  std::fprintf(stderr, "%s%s%s", terminal_ ? "\r" : "", text.c_str(), terminal_ ? "\033[K" : "\n");
  dirty_ = terminal_;
}

void ProgressLine::line(const std::string& text) {
  if (quiet_) return;
  finish();
  std::fprintf(stderr, "%s\n", text.c_str());
}

void ProgressLine::event(const Event& event) {
  line((event.level == Event::Level::kWarning ? "warning: " : "") + event.message);
}

void ProgressLine::finish() {
  if (dirty_) std::fputc('\n', stderr);
  dirty_ = false;
  shown_.clear();
}

}  // namespace raysfm::app
