#pragma once

#include <atomic>
#include <string>

#include "raysfm/core/events.h"
#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm::app {

// SIGINT, SIGTERM, SIGHUP and SIGPIPE from here on: the first asks for an orderly end; SIGINT and SIGTERM end
// at once when they come again.
class StopSignals {
 public:
  StopSignals();

  // Set by the first signal.
  const std::atomic<bool>* requested() const;
  // Of a run that a signal ended.
  int exit_code() const;
};

// How many frames of a tracked video have a pose, and what the map holds; one line without its end.
std::string counts_text(const Reconstruction& reconstruction);

// Writes text to standard output: exit code 0, or bad input where that cannot be written.
Result<int> printed(const std::string& text);

// One line of progress on stderr, rewritten in place on a terminal and written as plain lines elsewhere, and
// lines of text between. Nothing where quiet.
class ProgressLine {
 public:
  explicit ProgressLine(bool quiet);

  bool quiet() const { return quiet_; }
  bool terminal() const { return terminal_; }
  void show(const std::string& text);
  void line(const std::string& text);
  void event(const Event& event);
  void finish();

 private:
  bool quiet_, terminal_, dirty_ = false;
  std::string shown_;  // by show(), not to be shown twice
};

}  // namespace raysfm::app
