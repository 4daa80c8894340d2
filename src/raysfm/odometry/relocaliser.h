#pragma once

#include <span>
#include <vector>

#include "raysfm/features/descriptor.h"
#include "raysfm/odometry/localiser.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/view.h"

namespace raysfm {

// A key frame that may show what a view shows: its points where the view's corners look alike.
struct Place {
  int keyframe = -1;
  std::vector<TrackPixel> matches;  // many are wrong
};

constexpr int kDescribedPoints = 300;    // of a key frame, for one camera
constexpr int kKeyFramesPerSearch = 12;  // each costs the matching of its points with all corners

// Recognises places seen from a key frame whose images are there, from any side that leaves them a likeness:
// descriptors of up to kDescribedPoints points of every key frame that was looked at, 36 bytes each, 11 kB
// for a key frame of one camera. Costs nothing until the first search. Owns scratch memory.
class Relocaliser {
 public:
  // A key frame's features have moved: feature f to new_index_of_feature[f], nowhere where that is < 0.
  void forget_features(int keyframe, std::span<const int> new_index_of_feature);

  // For a new segment.
  void clear();

  // The likeliest places of a view, best first. Looks at no more than kKeyFramesPerSearch key frames, spread
  // evenly over the newest of which there are images, and at others in the next call.
  std::vector<Place> search(const Map& map, std::span<const KeyFrameView> views, const View& view);

 private:
  struct Keyframe {
    bool described = false;
    std::vector<int> features;  // of the map's key frame
    std::vector<Descriptor> descriptors;
  };

  Place match(const Map& map, int keyframe, const View& view) const;
  void describe(const View& view);
  void describe_keyframe(const MapKeyFrame& keyframe, const Map& map, const View& view, Keyframe* out);

  std::vector<Keyframe> keyframes_;
  Describer describer_;
  // Of the view searched for: descriptors, and the corner of a camera that each belongs to.
  std::vector<Descriptor> descriptors_;
  std::vector<std::pair<int, int>> corners_;
  int phase_ = 0;
};

}  // namespace raysfm
