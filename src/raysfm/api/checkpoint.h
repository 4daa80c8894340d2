#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "raysfm/api/track.h"
#include "raysfm/core/timer.h"
#include "raysfm/odometry/tracker.h"
#include "raysfm/streams/view_stream.h"

namespace raysfm {

// What identifies a run: its results depend on nothing else but the frames. One fact a line.
std::string run_identity(TrackSettings settings, const Rig& rig);

// The state of a run, written now and then, from which another goes on after a kill with the same results.
// What is written, and when, changes none.
class Checkpoint {
 public:
  // None, where `path` is empty: nothing is read or written then.
  Checkpoint(std::filesystem::path path, std::string identity)
      : path_(std::move(path)), identity_(std::move(identity)) {}

  // Reads what an earlier run left. What is not whole is as if it were not there, of which the user is told.
  // Errors: bad input, where it is of a run that is not this one, naming what differs.
  Result<void> read(const EventSink& event);

  // What that run has done already.
  const PassedViews& passed() const { return passed_; }

  // Takes up where it was: passes over the views of `stream`, made with passed(), and fills a new tracker.
  // Whether it was told to stop meanwhile. Errors: bad input, where the frames are others.
  Result<bool> go_on(ViewStream& stream, const TrackCallbacks& callbacks, Tracker& tracker);

  // To be told every view that is pushed.
  void note(const View& view);

  // Replaces the file where that is due: it takes a fiftieth of the time at most. Where it cannot be written
  // the user is told, once.
  void keep(Tracker& tracker, const EventSink& event);

 private:
  Error other_frames(int frame) const;

  std::filesystem::path path_;
  std::string identity_;
  PassedViews passed_;
  uint32_t passed_sum_ = 0, sum_ = 0;  // of what note() was told: up to the checkpoint, and now
  std::string state_;
  Clock::time_point written_ = Clock::now();
  double wait_ms_ = 1000;  // until the next one, after written_
};

}  // namespace raysfm
