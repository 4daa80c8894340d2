#include "raysfm/matching/extrinsics_check.h"

#include <fmt/format.h>

#include <numeric>

#include "raysfm/matching/across_matcher.h"

namespace raysfm {
namespace {

int matches_across(const TrackingRig& rig, const View& view) {
  MapKeyFrame corners;
  for (int c = 0; c < rig.size(); ++c) {
    const Features& features = view.cameras[c].features;
    for (int i = 0; i < features.size(); ++i) corners.add(c, features.pixels[i], features.octaves[i], -1);
  }
  std::vector<int> all(corners.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<AcrossMatch> matches;
  const ViewPtr unowned(ViewPtr(), &view);
  AcrossMatcher().match(rig, make_keyframe_view(unowned, corners, rig), view, all, &matches);
  return static_cast<int>(matches.size());
}

Rig inverted(Rig rig) {
  const Rigid3 rig_from_first = rig.cameras[0].rig_from_cam;
  for (Camera& camera : rig.cameras) {
    camera.rig_from_cam = rig_from_first * (rig_from_first.inverse() * camera.rig_from_cam).inverse();
  }
  return rig;
}

}  // namespace

std::optional<std::string> opposite_extrinsics(const TrackingRig& rig, const View& view) {
  constexpr int kMinMatches = 60;
  constexpr int kAdvantage = 3;  // chance finds one corner in twenty either way
  if (rig.size() < 2) return std::nullopt;
  const TrackingRig other(inverted(rig.rig()), ErrorMeasure::kAuto);
  if (other.common_views().empty()) return std::nullopt;
  const int as_given = matches_across(rig, view), opposite = matches_across(other, view);
  if (opposite < kMinMatches || opposite < kAdvantage * as_given) return std::nullopt;
  return fmt::format(
      "rig_from_cam of the cameras seems to be given in the opposite direction: {} corners of the "
      "first frame are seen by two cameras where the file says, {} where its inverse says",
      as_given, opposite);
}

}  // namespace raysfm
