#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/archive.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Tells frames that show once more what one before them showed: ten pictures a second in a file of thirty
// frames, in whatever rhythm, also where an encoder has changed the copies a little. They say nothing new,
// and are no further look at the scene.
//
// A copy has most pixels of the frame that it repeats, grey level by grey level, and nothing in it has moved.
// A camera that stands still has other noise in each frame, and is told by that. Where an encoder took most
// of the noise away, only the rhythm tells: copies come again and again, between pictures that have moved.
// What has hardly changed at all is a copy in any case.
class RepeatWatch {
 public:
  // The frame that the next one repeats: always the newest that repeats none itself; -1: none. `frame` is the
  // number of the next one, `pictures` what it shows, one for each stream, all of which must be repeated.
  int original_of(int frame, std::span<const GrayView> pictures);

  // Frames so far that repeat another.
  int repeats() const { return repeats_; }

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, original_, repeats_, rows_, runs_, in_run_);
  }

 private:
  enum class Likeness : uint8_t { kNone, kAlike, kSame };
  // Of a picture of the newest frame that is like none before: every so many-th row, and which part of its
  // pixels was another in the one that is like none before it (-1: unknown).
  struct Rows {
    int width = 0, height = 0;
    std::vector<uint8_t> pixels;
    double changed = -1;

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, width, height, pixels, changed);
    }
  };

  static double changed_part(const Rows& rows, const GrayView& picture);
  static double motion(const Rows& rows, const GrayView& picture);
  static Likeness likeness(const Rows& rows, const GrayView& picture, double changed);
  bool is_rhythm(int frame) const;
  static void keep(const GrayView& picture, double changed, Rows* rows);

  int original_ = -1;  // the newest frame that was said to repeat none
  int repeats_ = 0;
  std::vector<Rows> rows_;  // by stream
  std::vector<int> runs_;   // the newest frames of which what was alike before them moved on
  bool in_run_ = false;     // the newest frame is like the one of rows_
};

}  // namespace raysfm
