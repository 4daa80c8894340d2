#include "raysfm/page/frame_features.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace raysfm {
namespace {

constexpr int kTrackFrames = 8;

double tenths(double pixels) {
  return std::round(10 * pixels) / 10;
}

}  // namespace

FrameFeatures::FrameFeatures(const Reconstruction& reconstruction)
    : r_(reconstruction),
      finders_(r_.rig.cameras.begin(), r_.rig.cameras.end()),
      before_(r_.frames.size(), nullptr),
      after_(r_.frames.size(), nullptr) {
  for (const KeyFrame& keyframe : r_.keyframes) before_[keyframe.frame] = after_[keyframe.frame] = &keyframe;
  // Handed on from frame to frame of a world, whose frames may lie between those of others.
  const auto hand_on = [this](std::vector<const KeyFrame*>* keyframes, size_t f,
                              std::vector<const KeyFrame*>* last) {
    const int segment = r_.frames[f].segment;
    if (segment < 0) return;
    if ((*keyframes)[f]) (*last)[segment] = (*keyframes)[f];
    (*keyframes)[f] = (*last)[segment];
  };
  std::vector<const KeyFrame*> last(r_.segments.size(), nullptr), next(r_.segments.size(), nullptr);
  for (size_t f = 0; f < r_.frames.size(); ++f) hand_on(&before_, f, &last);
  for (size_t f = r_.frames.size(); f-- > 0;) hand_on(&after_, f, &next);
}

bool FrameFeatures::project(int frame, int camera, int point, Eigen::Vector2d* pixel) const {
  const PosedFrame& posed = r_.frames[frame];
  const Camera& c = camera_of(r_, posed, camera);
  const Rigid3 cam_from_world = (*posed.world_from_rig * c.rig_from_cam).inverse();
  const Eigen::Vector3d in_cam = cam_from_world * r_.points[point].position;
  const bool found = posed.lens >= 0 ? c.project(in_cam, pixel) : finders_[camera].find(in_cam, pixel);
  return found && c.contains(*pixel);
}

std::vector<FrameFeatures::Feature> FrameFeatures::matched(const KeyFrame& keyframe, int camera) const {
  std::vector<Feature> features;
  for (int k = keyframe.first_observation; k < keyframe.last_observation; ++k) {
    const Observation& o = r_.observations[k];
    if (o.camera == camera) features.push_back({o.point, o.pixel});
  }
  return features;
}

std::vector<FrameFeatures::Feature> FrameFeatures::expected(int frame, int camera) const {
  std::vector<int> points;
  for (const KeyFrame* keyframe : {before_[frame], after_[frame]}) {
    if (!keyframe) continue;
    for (const Feature& feature : matched(*keyframe, camera)) points.push_back(feature.point);
  }
  std::ranges::sort(points);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  std::vector<Feature> features;
  for (const int point : points) {
    Eigen::Vector2d pixel;
    if (project(frame, camera, point, &pixel)) features.push_back({point, pixel});
  }
  return features;
}

std::vector<double> FrameFeatures::track(const Feature& feature, int frame, int camera) const {
  std::vector<double> pixels = {tenths(feature.pixel.x()), tenths(feature.pixel.y())};
  for (int f = frame - 1; f >= 0 && f >= frame - kTrackFrames; --f) {
    Eigen::Vector2d pixel;
    if (!r_.frames[f].world_from_rig || r_.frames[f].segment != r_.frames[frame].segment) break;
    if (!project(f, camera, feature.point, &pixel)) break;
    pixels.push_back(tenths(pixel.x()));
    pixels.push_back(tenths(pixel.y()));
  }
  return pixels;
}

std::string FrameFeatures::json(int frame, int camera) const {
  nlohmann::json json = {{"size", {0, 0}}, {"seen", 0}, {"tracks", nlohmann::json::array()}};
  if (frame < 0 || frame >= static_cast<int>(r_.frames.size()) || camera < 0) return json.dump();
  const PosedFrame& posed = r_.frames[frame];
  const int cameras = posed.lens >= 0 ? 1 : static_cast<int>(r_.rig.cameras.size());
  if (!posed.world_from_rig || camera >= cameras) return json.dump();
  const Camera& c = camera_of(r_, posed, camera);
  json["size"] = {c.width, c.height};
  std::vector<Feature> features;
  if (before_[frame] && before_[frame]->frame == frame) features = matched(*before_[frame], camera);
  json["seen"] = features.size();
  if (features.empty()) features = expected(frame, camera);
  for (const Feature& feature : features) json["tracks"].push_back(track(feature, frame, camera));
  return json.dump();
}

}  // namespace raysfm
