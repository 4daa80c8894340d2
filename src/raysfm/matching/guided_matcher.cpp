#include "raysfm/matching/guided_matcher.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace raysfm {
namespace {

// A patch whose border moves by less than this many pixels is compared as it is.
constexpr float kRigidPatchTolerance = 0.12f * kPatchRadius;
constexpr float kMaxAreaRatio = 6.0f;
// A point that is seen larger than before is looked for in the octave where it was as large as before only
// from a factor of 2^(1 - this) on: up to there a finer octave is more exact. A half costs kitti07-mono a
// twentieth of its accuracy.
constexpr double kRatherFiner = 0.1;
// Mean square of a coordinate over an aligned patch of 11 x 11 pixels.
constexpr double kPatchMoment = 10;
// Pixels of the octave by which a patch may lie beside its middle: next to where a lens ends, or to the poles
// of a panorama, it is no longer deformed as any that can be foretold.
constexpr float kMostBent = 1.0f;

// A patch of the given octave.
bool nearly_rigid(const Eigen::Matrix2f& warp, int octave) {
  const float side = octave_side(octave);
  return (warp - side * Eigen::Matrix2f::Identity()).cwiseAbs().maxCoeff() * kPatchRadius <
         side * kRigidPatchTolerance;
}

// The octave of a picture whose pixels are most like those that a warp takes: half a step finer at most.
int sampled_octave(const Octaves& picture, const Eigen::Matrix2f& warp) {
  const float area = std::abs(warp.determinant());
  return picture.clamp(static_cast<int>(std::floor(0.5f * std::log2(std::max(area, 1e-6f)) + 0.42f)));
}

// Calls f(begin, end) for each run of queries that are equal by `key`.
template <typename Key, typename F>
void for_each_run(std::span<const PatchQuery> queries, Key key, F f) {
  for (size_t begin = 0; begin < queries.size();) {
    size_t end = begin + 1;
    while (end < queries.size() && key(queries[end]) == key(queries[begin])) ++end;
    f(static_cast<int>(begin), static_cast<int>(end));
    begin = end;
  }
}

// By the image that the patches are taken from.
template <typename F>
void for_each_source(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries, F f) {
  for_each_run(
      queries,
      [&](const PatchQuery& q) { return std::pair(q.keyframe, views[q.keyframe].cameras[q.feature]); }, f);
}

}  // namespace

bool predict_patch(const TrackingRig& rig, const KeyFrameView& keyframe, int feature, double distance,
                   int target, const Rigid3& target_from_source, const CameraView& view, PatchQuery* query) {
  const Eigen::Vector3d point = target_from_source * point_on_ray(keyframe, feature, distance);
  PointProjection seen;
  seen.in_image = rig.see(target, point, &seen.pixel, &seen.jacobian);
  return predict_patch(rig, keyframe, feature, distance, target,
                       target_from_source.rotation.toRotationMatrix(), point, seen, view, query);
}

bool predict_patch(const TrackingRig& rig, const KeyFrameView& keyframe, int feature, double distance,
                   int target, const Eigen::Matrix3d& target_from_source, const Eigen::Vector3d& point,
                   const PointProjection& seen, const CameraView& view, PatchQuery* query) {
  if (!seen.in_image) return false;
  const Eigen::Matrix<double, 3, 2> surface = keyframe.point_jacobians[feature].cast<double>();
  const Eigen::Matrix<double, 3, 2> surface_in_target = distance * (target_from_source * surface);
  const Eigen::Matrix2d target_from_patch = seen.jacobian * surface_in_target;
  // In pixels of the patch's octave and of the target's.
  const double area = target_from_patch.determinant();
  if (!(area > 1e-6 && area < 1e6)) return false;
  const int octave = keyframe.octaves[feature];
  const int wanted = octave + static_cast<int>(std::floor(0.5 * std::log2(area) + kRatherFiner));
  query->octave = view.clamp_octave(wanted);
  double in_octaves = std::ldexp(area, 2 * (octave - query->octave));
  const int softer = view.octaves->first() - keyframe.camera_view(feature).octaves->first();
  // What was found in a softer picture is too large for a corner of this one, but can be aligned.
  if (softer < 0 && in_octaves >= kMaxAreaRatio) {
    query->octave = std::min(view.octaves->clamp(wanted), query->octave - softer);
    in_octaves = std::ldexp(area, 2 * (octave - query->octave));
  }
  // And in a softer one it is compared in the octaves that are left.
  const double least = std::ldexp(1.0 / kMaxAreaRatio, -2 * std::max(0, softer));
  if (!(in_octaves > least && in_octaves < kMaxAreaRatio)) return false;
  query->camera = target;
  query->predicted = seen.pixel.cast<float>();
  const Eigen::Matrix2d patch_from_target = target_from_patch.inverse();
  query->keyframe_from_target = octave_side(query->octave) * patch_from_target.cast<float>();
  // The way from pixel w of the patch to pixel A w + q(w, w) / 2 of the target, on a plane:
  //   q(w, w) = A gamma_patch(w, w) - gamma_target(A w, A w) + 2 (receding . w) A w.
  const Eigen::Vector3d towards = point - rig.curvature(target).centre();
  const Eigen::Vector2d receding = surface.transpose() * keyframe.directions[feature].cast<double>() -
                                   surface_in_target.transpose() * towards / towards.squaredNorm();
  const Eigen::Vector2d bent =
      target_from_patch * rig.curvature(keyframe.cameras[feature])
                              .along(keyframe.pixels[feature].cast<double>(),
                                     patch_from_target * patch_from_target.transpose()) -
      rig.curvature(target).along(seen.pixel, Eigen::Matrix2d::Identity()) +
      2 * patch_from_target.transpose() * receding;
  query->bend = (std::ldexp(0.5 * kPatchMoment, 2 * query->octave) * bent).cast<float>();
  return query->bend.norm() < kMostBent * octave_side(query->octave);
}

void coarsen(const Octaves& picture, int octaves, PatchQuery* query) {
  const int octave = picture.clamp(query->octave + octaves);
  query->keyframe_from_target *= std::ldexp(1.0f, octave - query->octave);
  query->bend *= std::ldexp(1.0f, 2 * (octave - query->octave));
  query->octave = octave;
}

void GuidedMatcher::gather_patches(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries) {
  patches_.resize(static_cast<int>(queries.size()));
  for_each_source(views, queries, [&](int begin, int end) {
    const KeyFrameView& view = views[queries[begin].keyframe];
    const Octaves& picture = *view.camera_view(queries[begin].feature).octaves;
    const std::vector<GrayView> levels = picture.views();
    warped_query_.clear();
    pixels_.clear();
    warps_.clear();
    for (int i = begin; i < end; ++i) {
      const PatchQuery& q = queries[i];
      if (nearly_rigid(q.keyframe_from_target, view.octaves[q.feature])) {
        copy_patch(view.patches, q.feature, i, &patches_);
      } else {
        warped_query_.push_back(i);
        pixels_.push_back(into_octave(view.pixels[q.feature], picture.first()));
        warps_.push_back(q.keyframe_from_target / octave_side(picture.first()));
      }
    }
    extract_warped_patches(levels, pixels_, warps_, &warped_);
    for (size_t k = 0; k < warped_query_.size(); ++k) {
      copy_patch(warped_, static_cast<int>(k), warped_query_[k], &patches_);
    }
  });
}

// The queries for one image: octave by octave, since patches are alike only in the same one.
void GuidedMatcher::match_in(std::span<const KeyFrameView> views, const CameraView& target,
                             std::span<const PatchQuery> queries, int first_query, float min_zncc,
                             std::vector<GuidedMatch>* matches) {
  gather_patches(views, queries);
  pixels_.clear();
  for (const PatchQuery& q : queries) pixels_.push_back(q.predicted);
  for (int octave = target.first_octave(); octave <= target.last_octave(); ++octave) {
    radii_.clear();
    for (const PatchQuery& q : queries) radii_.push_back(q.octave == octave ? q.radius : 0);
    matcher_.match(patches_, pixels_, radii_, target.patches, target.features.pixels, target.grid(octave),
                   {.min_zncc = min_zncc}, &zncc_matches_);
    for (const ZnccMatch& m : zncc_matches_) {
      matches->push_back({first_query + m.query, m.train, target.features.pixels[m.train], octave, m.zncc});
    }
  }
}

void GuidedMatcher::match(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          const View& target, float min_zncc, std::vector<GuidedMatch>* matches) {
  matches->clear();
  for_each_run(
      queries, [](const PatchQuery& q) { return q.camera; },
      [&](int begin, int end) {
        match_in(views, target.cameras[queries[begin].camera], queries.subspan(begin, end - begin), begin,
                 min_zncc, matches);
      });
  std::stable_sort(matches->begin(), matches->end(),
                   [](const GuidedMatch& a, const GuidedMatch& b) { return a.query < b.query; });
}

// The patch of a query in one octave of the target. The warp is that of the query, to pixels of this octave.
AlignedPatch GuidedMatcher::align_in(int octave, const KeyFrameView& keyframe, const PatchQuery& query,
                                     const Eigen::Matrix2f& keyframe_from_octave, const View& target,
                                     const Eigen::Vector2f& start,
                                     const PatchAlignmentOptions& options) const {
  const Octaves &reference = *keyframe.camera_view(query.feature).octaves,
                &picture = *target.cameras[query.camera].octaves;
  const int sampled = sampled_octave(reference, keyframe_from_octave);
  const Eigen::Vector2f in_reference = into_octave(keyframe.pixels[query.feature], sampled);
  const Eigen::Vector2f in_target = into_octave(start, octave);
  const Eigen::Matrix2f warp = keyframe_from_octave / octave_side(sampled);
  AlignedPatch aligned;
  aligned.octave = octave;
  PatchAligner(options).align(reference.at(sampled), std::span(&in_reference, 1), std::span(&warp, 1),
                              picture.at(octave), std::span(&in_target, 1),
                              std::span<PatchAlignment>(static_cast<PatchAlignment*>(&aligned), 1));
  aligned.pixel = out_of_octave(aligned.pixel, octave);
  return aligned;
}

// What is seen in a coarse octave may have a finer core.
AlignedPatch GuidedMatcher::align_finer(AlignedPatch best, const KeyFrameView& keyframe,
                                        const PatchQuery& query, const View& target,
                                        const PatchAlignmentOptions& options) const {
  Eigen::Matrix2f warp = 0.5f * query.keyframe_from_target;
  const int first = target.cameras[query.camera].octaves->first();
  for (int o = query.octave - 1; best.converged && o >= first; --o, warp *= 0.5f) {
    const AlignedPatch finer = align_in(o, keyframe, query, warp, target, best.pixel, options);
    if (!finer.converged) break;
    best = finer;
  }
  return best;
}

void GuidedMatcher::align(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          std::span<const Eigen::Vector2f> starts, const View& target,
                          const PatchAlignmentOptions& options, std::vector<AlignedPatch>* out,
                          FinerOctaves finer) {
  out->resize(queries.size());
  for (size_t i = 0; i < queries.size(); ++i) {
    const PatchQuery& q = queries[i];
    const KeyFrameView& keyframe = views[q.keyframe];
    AlignedPatch& best = (*out)[i];
    best = align_in(q.octave, keyframe, q, q.keyframe_from_target, target, starts[i], options);
    if (finer == FinerOctaves::kTried) best = align_finer(best, keyframe, q, target, options);
    if (best.converged) best.pixel -= std::ldexp(1.0f, 2 * (best.octave - q.octave)) * q.bend;
  }
}

}  // namespace raysfm
