#pragma once

#include <span>
#include <vector>

#include "raysfm/matching/guided_matcher.h"

namespace raysfm {

// Where another camera of the rig sees a feature of the same instant.
struct AcrossMatch {
  int feature = 0;  // of the key frame
  int camera = 0;
  int octave = 0;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
};

// Finds features of a view in the other cameras that share a part of their field of view. The rig is known,
// so that each is looked for along its epipolar line, from near to infinitely far; a match must be the only
// one that looks alike, and meet the line. Owns scratch memory.
class AcrossMatcher {
 public:
  // `features` of the key frame view that was made of `view`, each at most once in each other camera.
  void match(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
             std::span<const int> features, std::vector<AcrossMatch>* matches);

 private:
  void collect_queries(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
                       std::span<const int> features, int from, int to);
  void keep_unambiguous();
  void align(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
             std::vector<AcrossMatch>* matches);

  GuidedMatcher matcher_;
  std::vector<PatchQuery> queries_, chosen_;
  std::vector<GuidedMatch> found_;
  std::vector<Eigen::Vector2f> starts_;
  std::vector<AlignedPatch> alignments_;
};

}  // namespace raysfm
