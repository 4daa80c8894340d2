#include "raysfm/odometry/guided_matcher.h"

#include <cstring>

namespace raysfm {
namespace {

// A patch whose border moves by less than this many pixels is compared as it is.
constexpr float kRigidPatchTolerance = 0.12f * kPatchRadius;
constexpr float kMaxAreaRatio = 6.0f;

bool nearly_identity(const Eigen::Matrix2f& warp) {
  return (warp - Eigen::Matrix2f::Identity()).cwiseAbs().maxCoeff() * kPatchRadius < kRigidPatchTolerance;
}

// Calls f(begin, end) for each run of queries of one key frame.
template <typename F>
void for_each_keyframe(std::span<const PatchQuery> queries, F f) {
  for (size_t begin = 0; begin < queries.size();) {
    size_t end = begin + 1;
    while (end < queries.size() && queries[end].keyframe == queries[begin].keyframe) ++end;
    f(static_cast<int>(begin), static_cast<int>(end));
    begin = end;
  }
}

}  // namespace

bool predict_patch(const Camera& camera, const KeyFrameView& keyframe, int feature, double distance,
                   const Rigid3& target_from_keyframe, PatchQuery* query) {
  const Eigen::Vector3d point = distance * keyframe.directions[feature].cast<double>();
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> projection;
  if (!camera.project(target_from_keyframe * point, &pixel, &projection) || !camera.contains(pixel))
    return false;
  const Eigen::Matrix2d target_from_patch =
      projection *
      (target_from_keyframe.rotation.toRotationMatrix() * keyframe.ray_jacobians[feature].cast<double>()) *
      distance;
  const double area = target_from_patch.determinant();
  if (!(area > 1.0 / kMaxAreaRatio && area < kMaxAreaRatio)) return false;
  query->predicted = pixel.cast<float>();
  query->keyframe_from_target = target_from_patch.inverse().cast<float>();
  return true;
}

void GuidedMatcher::gather_patches(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries) {
  patches_.resize(static_cast<int>(queries.size()));
  const auto copy = [this](const PatchSet& from, int i, int to) {
    std::memcpy(patches_.mutable_patch(to), from.patch(i), kPatchStride);
    patches_.set_inverse_norm(to, from.inverse_norm(i));
  };
  for_each_keyframe(queries, [&](int begin, int end) {
    const KeyFrameView& view = views[queries[begin].keyframe];
    warped_query_.clear();
    pixels_.clear();
    warps_.clear();
    for (int i = begin; i < end; ++i) {
      const PatchQuery& q = queries[i];
      if (nearly_identity(q.keyframe_from_target)) {
        copy(view.patches, q.feature, i);
      } else {
        warped_query_.push_back(i);
        pixels_.push_back(view.pixels[q.feature]);
        warps_.push_back(q.keyframe_from_target);
      }
    }
    extract_warped_patches(view.view->image.view(), pixels_, warps_, &warped_);
    for (size_t k = 0; k < warped_query_.size(); ++k) copy(warped_, static_cast<int>(k), warped_query_[k]);
  });
}

void GuidedMatcher::match(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          const View& target, float min_zncc, std::vector<GuidedMatch>* matches) {
  gather_patches(views, queries);
  pixels_.clear();
  radii_.clear();
  for (const PatchQuery& q : queries) {
    pixels_.push_back(q.predicted);
    radii_.push_back(q.radius);
  }
  matcher_.match(patches_, pixels_, radii_, target.patches, target.features.pixels, target.grid,
                 {.min_zncc = min_zncc}, &zncc_matches_);
  matches->clear();
  for (const ZnccMatch& m : zncc_matches_) {
    matches->push_back({m.query, m.train, target.features.pixels[m.train], m.zncc});
  }
}

void GuidedMatcher::align(std::span<const KeyFrameView> views, std::span<const PatchQuery> queries,
                          std::span<const Eigen::Vector2f> starts, const View& target,
                          const PatchAlignmentOptions& options, std::vector<PatchAlignment>* out) {
  const PatchAligner aligner(options);
  out->resize(queries.size());
  for_each_keyframe(queries, [&](int begin, int end) {
    const KeyFrameView& view = views[queries[begin].keyframe];
    pixels_.clear();
    warps_.clear();
    for (int i = begin; i < end; ++i) {
      pixels_.push_back(view.pixels[queries[i].feature]);
      warps_.push_back(queries[i].keyframe_from_target);
    }
    aligner.align(view.view->image.view(), pixels_, warps_, target.image.view(),
                  starts.subspan(begin, end - begin), std::span(*out).subspan(begin, end - begin));
  });
}

}  // namespace raysfm
