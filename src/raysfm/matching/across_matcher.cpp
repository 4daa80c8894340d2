#include "raysfm/matching/across_matcher.h"

#include <algorithm>

#include "raysfm/geometry/triangulation.h"

namespace raysfm {
namespace {

constexpr float kMinAcrossZncc = 0.8f;
constexpr float kLead = 0.03f;  // of the best match's correlation over that of any other place
// Pixels of the octave: the same place, and the radius of the regions of interest that cover the epipolar
// line.
constexpr float kSamePlace = 3.0f, kStepRadius = 8.0f;
constexpr int kMaxSteps = 64;         // regions for one feature
constexpr double kNearest = 3;        // baselines
constexpr double kFarthest = 1000;    // baselines
constexpr double kEpipolarError = 1;  // pixels of the octave

}  // namespace

// Regions of interest along the epipolar lines of the features of camera `from` in camera `to`.
void AcrossMatcher::collect_queries(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
                                    std::span<const int> features, int from, int to) {
  const Rigid3 to_from_from = rig.cam_from_rig(to) * rig.camera(from).rig_from_cam;
  const double baseline = to_from_from.translation.norm();
  queries_.clear();
  for (const int f : features) {
    if (keyframe.cameras[f] != from) continue;
    const float radius = kStepRadius * octave_side(keyframe.octaves[f]);
    PatchQuery query{.keyframe = 0, .feature = f, .track = f, .radius = 1.5f * radius};
    // From far to near by inverse distance, in steps of about a region's diameter.
    double inverse = 1 / (kFarthest * baseline), step = 0.1 / (kNearest * baseline);
    Eigen::Vector2f last;
    bool seen = false;
    for (int i = 0; i < kMaxSteps && inverse <= 1 / (kNearest * baseline); ++i, inverse += step) {
      if (!predict_patch(rig, keyframe, f, 1 / inverse, to, to_from_from, view.cameras[to], &query)) continue;
      if (seen) {
        const float moved = (query.predicted - last).norm();
        step *= std::clamp(2 * radius / std::max(moved, 0.1f), 0.5f, 4.0f);
      }
      last = query.predicted;
      seen = true;
      queries_.push_back(query);
    }
  }
}

// Of all matches of a feature the best, unless another place looks almost as good.
void AcrossMatcher::keep_unambiguous() {
  std::stable_sort(found_.begin(), found_.end(), [&](const GuidedMatch& a, const GuidedMatch& b) {
    return queries_[a.query].feature < queries_[b.query].feature;
  });
  chosen_.clear();
  starts_.clear();
  for (size_t begin = 0, end = 0; begin < found_.size(); begin = end) {
    const int feature = queries_[found_[begin].query].feature;
    size_t best = begin;
    for (end = begin; end < found_.size() && queries_[found_[end].query].feature == feature; ++end) {
      if (found_[end].zncc > found_[best].zncc) best = end;
    }
    const float same_place = kSamePlace * octave_side(found_[best].octave);
    const bool rival = std::any_of(found_.begin() + begin, found_.begin() + end, [&](const GuidedMatch& m) {
      return m.zncc > found_[best].zncc - kLead && (m.pixel - found_[best].pixel).norm() > same_place;
    });
    if (rival) continue;
    chosen_.push_back(queries_[found_[best].query]);
    starts_.push_back(found_[best].pixel);
  }
}

void AcrossMatcher::align(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
                          std::vector<AcrossMatch>* matches) {
  matcher_.align(std::span(&keyframe, 1), chosen_, starts_, view, {}, &alignments_);
  for (size_t i = 0; i < chosen_.size(); ++i) {
    if (!alignments_[i].converged) continue;
    const int cameras[2] = {keyframe.cameras[chosen_[i].feature], chosen_[i].camera};
    const Eigen::Vector2f pixels[2] = {keyframe.pixels[chosen_[i].feature], alignments_[i].pixel};
    Ray rays[2];
    bool ok = true;
    for (int k = 0; k < 2 && ok; ++k) {
      const Camera& camera = rig.camera(cameras[k]);
      ok = camera.ray(pixels[k].cast<double>(), &rays[k]);
      rays[k] = {camera.rig_from_cam * rays[k].origin, camera.rig_from_cam.rotation * rays[k].direction};
    }
    Triangulation point;
    const double error = kEpipolarError * octave_side(alignments_[i].octave) / rig.pixels_per_radian();
    if (!ok || !triangulate(rays, &point) || point.max_angle > error) continue;
    matches->push_back({chosen_[i].feature, chosen_[i].camera, alignments_[i].octave, alignments_[i].pixel});
  }
}

void AcrossMatcher::match(const TrackingRig& rig, const KeyFrameView& keyframe, const View& view,
                          std::span<const int> features, std::vector<AcrossMatch>* matches) {
  matches->clear();
  for (const auto& [from, to] : rig.common_views()) {
    if (from > to) continue;  // what the first finds in the second need not be looked for again
    collect_queries(rig, keyframe, view, features, from, to);
    matcher_.match(std::span(&keyframe, 1), queries_, view, kMinAcrossZncc, &found_);
    keep_unambiguous();
    align(rig, keyframe, view, matches);
  }
}

}  // namespace raysfm
