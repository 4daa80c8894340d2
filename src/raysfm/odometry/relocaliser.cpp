#include "raysfm/odometry/relocaliser.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace raysfm {
namespace {

constexpr int kPlaces = 3;            // that are worth a closer look
constexpr int kMinPlaceMatches = 20;  // no pose comes from fewer
constexpr float kMaxRatio = 0.85f;    // of the distances to the nearest corner and to the next

// The features of one camera that have a position, the best supported of each cell of the image first, then
// the second best, and so on; in the order of the key frame.
std::vector<int> choose_features(const Map& map, const MapKeyFrame& keyframe, int camera,
                                 const CameraView& view) {
  const double cell = std::sqrt(2.0 * view.width * view.height / kDescribedPoints);
  struct Candidate {
    int place_in_cell, feature;
  };
  std::vector<std::pair<int, int>> supported;  // (minus observations, feature)
  for (int f = 0; f < keyframe.size(); ++f) {
    const int track = keyframe.tracks[f];
    if (keyframe.cameras[f] != camera || track < 0 || !keyframe.inliers[f]) continue;
    if (!map.tracks[track].triangulated) continue;
    supported.push_back({-static_cast<int>(map.tracks[track].observations.size()), f});
  }
  std::sort(supported.begin(), supported.end());
  std::unordered_map<int, int> taken;  // by cell
  std::vector<Candidate> candidates;
  const int columns = static_cast<int>(view.width / cell) + 1;
  for (const auto& [support, f] : supported) {
    const Eigen::Vector2f& p = keyframe.pixels[f];
    candidates.push_back(
        {taken[static_cast<int>(p.y() / cell) * columns + static_cast<int>(p.x() / cell)]++, f});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.place_in_cell < b.place_in_cell; });
  candidates.resize(std::min<size_t>(candidates.size(), kDescribedPoints));
  std::vector<int> features;
  for (const Candidate& c : candidates) features.push_back(c.feature);
  std::sort(features.begin(), features.end());
  return features;
}

}  // namespace

void Relocaliser::describe_keyframe(const MapKeyFrame& keyframe, const Map& map, const View& view,
                                    Keyframe* out) {
  out->described = true;
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    const std::vector<int> features = choose_features(map, keyframe, c, view.cameras[c]);
    std::vector<Eigen::Vector2f> pixels;
    std::vector<uint8_t> octaves;
    for (const int f : features) {
      pixels.push_back(keyframe.pixels[f]);
      octaves.push_back(keyframe.octaves[f]);
    }
    DescriptorSet set;
    describer_.describe(*view.cameras[c].octaves, pixels, octaves, &set);
    for (const int i : set.corners) out->features.push_back(features[i]);
    out->descriptors.insert(out->descriptors.end(), set.descriptors.begin(), set.descriptors.end());
  }
}

void Relocaliser::forget_features(int keyframe, std::span<const int> new_index_of_feature) {
  if (keyframe >= static_cast<int>(keyframes_.size())) return;
  Keyframe& k = keyframes_[keyframe];
  size_t kept = 0;
  for (size_t i = 0; i < k.features.size(); ++i) {
    const int feature = new_index_of_feature[k.features[i]];
    if (feature < 0) continue;
    k.features[kept] = feature;
    k.descriptors[kept++] = k.descriptors[i];
  }
  k.features.resize(kept);
  k.descriptors.resize(kept);
  if (kept == 0) k = {};
}

void Relocaliser::clear() {
  keyframes_.clear();
  phase_ = 0;
}

void Relocaliser::describe(const View& view) {
  descriptors_.clear();
  corners_.clear();
  DescriptorSet set;
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    const CameraView& camera = view.cameras[c];
    describer_.describe(*camera.octaves, camera.features.pixels, camera.features.octaves, &set);
    descriptors_.insert(descriptors_.end(), set.descriptors.begin(), set.descriptors.end());
    for (const int corner : set.corners) corners_.push_back({c, corner});
  }
}

Place Relocaliser::match(const Map& map, int keyframe, const View& view) const {
  Place place{keyframe, {}};
  const Keyframe& k = keyframes_[keyframe];
  std::vector<DescriptorMatch> matches;
  match_descriptors(k.descriptors, descriptors_, kMaxRatio, &matches);
  for (const DescriptorMatch& m : matches) {
    const int track = map.keyframes[keyframe].tracks[k.features[m.query]];
    if (track < 0 || !map.tracks[track].triangulated) continue;
    const auto& [camera, corner] = corners_[m.train];
    const Features& features = view.cameras[camera].features;
    place.matches.push_back(
        {track, static_cast<uint8_t>(camera), features.octaves[corner], features.pixels[corner]});
  }
  return place;
}

std::vector<Place> Relocaliser::search(const Map& map, std::span<const KeyFrameView> views,
                                       const View& view) {
  describe(view);
  const int end = static_cast<int>(map.keyframes.size());
  keyframes_.resize(end);
  int oldest = end;
  while (oldest > 0 && views[oldest - 1].view) --oldest;
  const int stride = std::max(1, (end - oldest + kKeyFramesPerSearch - 1) / kKeyFramesPerSearch);
  std::vector<Place> places;
  for (int k = oldest + phase_++ % stride; k < end; k += stride) {
    if (!keyframes_[k].described) describe_keyframe(map.keyframes[k], map, *views[k].view, &keyframes_[k]);
    Place place = match(map, k, view);
    if (static_cast<int>(place.matches.size()) >= kMinPlaceMatches) places.push_back(std::move(place));
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.matches.size() > b.matches.size(); });
  places.resize(std::min<size_t>(places.size(), kPlaces));
  return places;
}

}  // namespace raysfm
