#pragma once

#include <span>
#include <vector>

#include "raysfm/features/patch_alignment.h"
#include "raysfm/features/zncc_matcher.h"
#include "raysfm/odometry/view.h"

namespace raysfm {

// A patch of a key frame that is looked for in another image, and where geometry expects it.
struct PatchQuery {
  int keyframe = 0;
  int feature = 0;
  int camera = 0;  // that should see it
  int track = -1;
  bool in_anchor = false;                                              // passed through for the caller
  Eigen::Vector2f predicted = Eigen::Vector2f::Zero();                 // pixel in the other image
  Eigen::Matrix2f keyframe_from_target = Eigen::Matrix2f::Identity();  // how the patch is deformed
  float radius = 0;                                                    // of the region of interest, pixels
};

// Predicts where camera `target` sees the point at `distance` along the ray of a key frame's feature, and how
// the patch around it is deformed, taking the surface to face the key frame. `target_from_source` leads from
// the camera of the feature at the key frame to the target. False where the target does not see it, or sees
// it at a scale too different to be compared (beyond a factor of about 2.5).
bool predict_patch(const TrackingRig& rig, const KeyFrameView& keyframe, int feature, double distance,
                   int target, const Rigid3& target_from_source, PatchQuery* query);

struct GuidedMatch {
  int query = -1;
  int feature = -1;  // of the target view, -1 where only the alignment found the place
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  float zncc = 0;
};

// Finds patches of key frames in another view, LBA09 2.1 with a region of interest and a patch shape that
// follow from the motion. Queries must be sorted by camera, and for one camera by key frame. Owns scratch
// memory.
class GuidedMatcher {
 public:
  // Corners of the target that look like the queries, each matched once (winner takes all, both ways).
  void match(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries, const View& target,
             float min_zncc, std::vector<GuidedMatch>* matches);

  // Sub-pixel places of queries in the target, from the given starts. Element i of `out` belongs to query i.
  void align(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
             std::span<const Eigen::Vector2f> starts, const View& target,
             const PatchAlignmentOptions& options, std::vector<PatchAlignment>* out);

 private:
  void gather_patches(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries);

  ZnccMatcher matcher_;
  PatchSet patches_;  // one per query
  PatchSet warped_;   // of one image
  std::vector<int> warped_query_;
  std::vector<Eigen::Vector2f> pixels_;
  std::vector<Eigen::Matrix2f> warps_;
  std::vector<float> radii_;
  std::vector<ZnccMatch> zncc_matches_;
};

}  // namespace raysfm
