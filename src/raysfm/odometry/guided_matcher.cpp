#include "raysfm/odometry/guided_matcher.h"

#include <tuple>
#include <utility>

namespace raysfm {
namespace {

// A patch whose border moves by less than this many pixels is compared as it is.
constexpr float kRigidPatchTolerance = 0.12f * kPatchRadius;
constexpr float kMaxAreaRatio = 6.0f;

bool nearly_identity(const Eigen::Matrix2f& warp) {
  return (warp - Eigen::Matrix2f::Identity()).cwiseAbs().maxCoeff() * kPatchRadius < kRigidPatchTolerance;
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
                   int target, const Rigid3& target_from_source, PatchQuery* query) {
  const Eigen::Vector3d point =
      keyframe.origins[feature].cast<double>() + distance * keyframe.directions[feature].cast<double>();
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> projection;
  if (!rig.see(target, target_from_source * point, &pixel, &projection)) return false;
  const Eigen::Matrix2d target_from_patch =
      projection *
      (target_from_source.rotation.toRotationMatrix() * keyframe.ray_jacobians[feature].cast<double>()) *
      distance;
  const double area = target_from_patch.determinant();
  if (!(area > 1.0 / kMaxAreaRatio && area < kMaxAreaRatio)) return false;
  query->camera = target;
  query->predicted = pixel.cast<float>();
  query->keyframe_from_target = target_from_patch.inverse().cast<float>();
  return true;
}

void GuidedMatcher::gather_patches(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries) {
  patches_.resize(static_cast<int>(queries.size()));
  for_each_source(views, queries, [&](int begin, int end) {
    const KeyFrameView& view = views[queries[begin].keyframe];
    warped_query_.clear();
    pixels_.clear();
    warps_.clear();
    for (int i = begin; i < end; ++i) {
      const PatchQuery& q = queries[i];
      if (nearly_identity(q.keyframe_from_target)) {
        copy_patch(view.patches, q.feature, i, &patches_);
      } else {
        warped_query_.push_back(i);
        pixels_.push_back(view.pixels[q.feature]);
        warps_.push_back(q.keyframe_from_target);
      }
    }
    extract_warped_patches(view.camera_view(queries[begin].feature).image.view(), pixels_, warps_, &warped_);
    for (size_t k = 0; k < warped_query_.size(); ++k) {
      copy_patch(warped_, static_cast<int>(k), warped_query_[k], &patches_);
    }
  });
}

void GuidedMatcher::match(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          const View& target, float min_zncc, std::vector<GuidedMatch>* matches) {
  matches->clear();
  for_each_run(
      queries, [](const PatchQuery& q) { return q.camera; },
      [&](int begin, int end) {
        const CameraView& image = target.cameras[queries[begin].camera];
        const std::span<const PatchQuery> part = queries.subspan(begin, end - begin);
        gather_patches(views, part);
        pixels_.clear();
        radii_.clear();
        for (const PatchQuery& q : part) {
          pixels_.push_back(q.predicted);
          radii_.push_back(q.radius);
        }
        matcher_.match(patches_, pixels_, radii_, image.patches, image.features.pixels, image.grid,
                       {.min_zncc = min_zncc}, &zncc_matches_);
        for (const ZnccMatch& m : zncc_matches_) {
          matches->push_back({begin + m.query, m.train, image.features.pixels[m.train], m.zncc});
        }
      });
}

void GuidedMatcher::align(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          std::span<const Eigen::Vector2f> starts, const View& target,
                          const PatchAlignmentOptions& options, std::vector<PatchAlignment>* out) {
  const PatchAligner aligner(options);
  out->resize(queries.size());
  for_each_run(
      queries,
      [&](const PatchQuery& q) {
        return std::tuple(q.camera, q.keyframe, views[q.keyframe].cameras[q.feature]);
      },
      [&](int begin, int end) {
        const KeyFrameView& view = views[queries[begin].keyframe];
        pixels_.clear();
        warps_.clear();
        for (int i = begin; i < end; ++i) {
          pixels_.push_back(view.pixels[queries[i].feature]);
          warps_.push_back(queries[i].keyframe_from_target);
        }
        aligner.align(view.camera_view(queries[begin].feature).image.view(), pixels_, warps_,
                      target.cameras[queries[begin].camera].image.view(), starts.subspan(begin, end - begin),
                      std::span(*out).subspan(begin, end - begin));
      });
}

}  // namespace raysfm
