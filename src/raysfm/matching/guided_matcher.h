#pragma once

#include <span>
#include <vector>

#include "raysfm/features/patch_alignment.h"
#include "raysfm/features/zncc_matcher.h"
#include "raysfm/views/view.h"

namespace raysfm {

// A patch of a key frame that is looked for in another image, and where geometry expects it.
struct PatchQuery {
  int keyframe = 0;
  int feature = 0;
  int camera = 0;                                       // that should see it
  int track = -1, point = -1;                           // passed through for the caller
  Eigen::Vector2f predicted = Eigen::Vector2f::Zero();  // pixel in the other image
  int octave = 0;                                       // of the other image, to look in
  // How the patch is deformed: pixels of the key frame as taken from those of the octave of the other image.
  Eigen::Matrix2f keyframe_from_target = Eigen::Matrix2f::Identity();
  float radius = 0;  // of the region of interest, pixels
  // By how much the patch as a whole lies beside its centre in the other image, pixels of that, where lens
  // and perspective deform it otherwise than linearly: the alignment finds it there.
  Eigen::Vector2f bend = Eigen::Vector2f::Zero();
};

// Predicts where camera `target` sees the point at `distance` along the ray of a key frame's feature, and how
// the patch around it is deformed, by the surface about it as far as that is known (see fit_surfaces());
// chooses the octave of `view`, of the target camera, in which it looks most alike. `target_from_source`
// leads from the camera of the feature at the key frame to the target. False where the target does not see
// it, or sees it at a scale too different to be compared (beyond a factor of about 2.5 to the octaves that
// there are), or bent.
bool predict_patch(const TrackingRig& rig, const KeyFrameView& keyframe, int feature, double distance,
                   int target, const Rigid3& target_from_source, const CameraView& view, PatchQuery* query);

// The same of a point that may lie somewhat beside the ray: `point` in the target's frame, as it sees it; of
// the source's place in the target the rotation is enough.
bool predict_patch(const TrackingRig& rig, const KeyFrameView& keyframe, int feature, double distance,
                   int target, const Eigen::Matrix3d& target_from_source, const Eigen::Vector3d& point,
                   const PointProjection& seen, const CameraView& view, PatchQuery* query);

// Makes a query that looks some octaves higher, as far as `picture`, of its camera, has them.
void coarsen(const Octaves& picture, int octaves, PatchQuery* query);

// A query found in the target.
struct GuidedMatch {
  int query = -1;
  int feature = -1;  // of the target view, -1 where only the alignment found the place
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  int octave = 0;  // of the target, in which it was found
  float zncc = 0;
};

// Sub-pixel place of a patch; `octave` is that of the target in which it was measured.
struct AlignedPatch : PatchAlignment {
  int octave = 0;
};

// Whether a patch that was found is aligned again in finer octaves.
enum class FinerOctaves : uint8_t { kTried, kLeft };

// Finds patches of key frames in another view, LBA09 2.1 with a region of interest and a patch shape that
// follow from the motion. Queries must be sorted by camera, and for one camera by key frame. Owns scratch
// memory.
class GuidedMatcher {
 public:
  // Corners of the target that look like the queries, each matched once (winner takes all, both ways).
  void match(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries, const View& target,
             float min_zncc, std::vector<GuidedMatch>* matches);

  // Sub-pixel places of queries in the target, from the given starts, in the finest octave that the patch is
  // seen in, or in that of the query alone. Element i of `out` belongs to query i.
  void align(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
             std::span<const Eigen::Vector2f> starts, const View& target,
             const PatchAlignmentOptions& options, std::vector<AlignedPatch>* out,
             FinerOctaves finer = FinerOctaves::kTried);

 private:
  void gather_patches(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries);
  void match_in(std::span<const KeyFrameView> views, const CameraView& target,
                std::span<const PatchQuery> queries, int first_query, float min_zncc,
                std::vector<GuidedMatch>* matches);
  AlignedPatch align_in(int octave, const KeyFrameView& keyframe, const PatchQuery& query,
                        const Eigen::Matrix2f& keyframe_from_octave, const View& target,
                        const Eigen::Vector2f& start, const PatchAlignmentOptions& options) const;
  AlignedPatch align_finer(AlignedPatch best, const KeyFrameView& keyframe, const PatchQuery& query,
                           const View& target, const PatchAlignmentOptions& options) const;

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
