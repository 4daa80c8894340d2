#pragma once

#include <optional>
#include <vector>

#include "raysfm/core/archive.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Part of what the images of a key frame show that stands in no relation to its map, 0 to 1: of the square
// cells of the images that have corners, those where hardly any of these became a point or was found again
// along its epipolar line. To be asked once later key frames have looked for its corners, and before those
// that they did not find are dropped. Nothing where too few cells have corners.
std::optional<double> unexplained_part(const Map& map, int keyframe, const TrackingRig& rig);

// Frames, first to last, of which a large part does not stand still in the world that was tracked. Either
// something large moves by itself, or the world is that of something that moves.
struct OtherMotion {
  int first = 0, last = 0;
  double part = 0;  // the largest mean of three key frames, 0 to 1
};

template <typename A>
void archive_fields(A& a, OtherMotion& x) {
  archive(a, x.first, x.last, x.part);
}

// Watches what unexplained_part() says of key frame after key frame.
class MotionWatch {
 public:
  // Key frames in the order of their frames.
  void add(int frame, double unexplained);
  // The next key frame is of another world.
  void restart();
  // Of the newest key frame of the present world alone, whether there is something to say.
  bool is_much() const;
  // All so far. A world of fewer than three key frames is judged by what it has.
  std::vector<OtherMotion> seen() const;

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, seen_, recent_, judged_);
  }

 private:
  struct Share {
    int frame = 0;
    double part = 0;

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, frame, part);
    }
  };
  static void judge(const std::vector<Share>& shares, std::vector<OtherMotion>* seen);

  std::vector<OtherMotion> seen_;
  std::vector<Share> recent_;  // at most three of the present world
  bool judged_ = false;        // they were, as three
};

}  // namespace raysfm
