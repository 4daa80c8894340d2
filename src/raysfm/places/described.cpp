#include "raysfm/places/described.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace raysfm {
namespace {

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

void describe_keyframe(const Map& map, const View& view, Describer& describer, MapKeyFrame* keyframe) {
  keyframe->described.clear();
  keyframe->descriptors.clear();
  std::vector<std::pair<int, Descriptor>> described;
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    const std::vector<int> features = choose_features(map, *keyframe, c, view.cameras[c]);
    std::vector<Eigen::Vector2f> pixels;
    std::vector<uint8_t> octaves;
    for (const int f : features) {
      pixels.push_back(keyframe->pixels[f]);
      octaves.push_back(keyframe->octaves[f]);
    }
    DescriptorSet set;
    describer.describe(*view.cameras[c].octaves, pixels, octaves, &set);
    for (int i = 0; i < set.size(); ++i) described.push_back({features[set.corners[i]], set.descriptors[i]});
  }
  if (view.cameras.size() > 1) std::ranges::sort(described, {}, &std::pair<int, Descriptor>::first);
  keyframe->described.reserve(described.size());
  keyframe->descriptors.reserve(described.size());
  for (const auto& [feature, descriptor] : described) {
    keyframe->described.push_back(feature);
    keyframe->descriptors.push_back(descriptor);
  }
}

DescribedCorners describe_corners(const View& view, Describer& describer) {
  DescribedCorners out;
  DescriptorSet set;
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    const CameraView& camera = view.cameras[c];
    const Features& features = camera.features;
    describer.describe(*camera.octaves, features.pixels, features.octaves, &set);
    out.descriptors.insert(out.descriptors.end(), set.descriptors.begin(), set.descriptors.end());
    for (const int i : set.corners) {
      out.corners.push_back({-1, static_cast<uint8_t>(c), features.octaves[i], features.pixels[i]});
    }
  }
  return out;
}

void describe_upright(const View& view, Describer& describer, DescribedCorners* corners) {
  corners->upright.resize(corners->corners.size());
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    std::vector<int> of_camera;
    std::vector<Eigen::Vector2f> pixels;
    std::vector<uint8_t> octaves;
    for (int i = 0; i < static_cast<int>(corners->corners.size()); ++i) {
      const TrackPixel& corner = corners->corners[i];
      if (corner.camera != c) continue;
      of_camera.push_back(i);
      pixels.push_back(corner.pixel);
      octaves.push_back(corner.octave);
    }
    std::vector<UprightDescriptor> upright;
    describer.describe_upright(*view.cameras[c].octaves, pixels, octaves, &upright);
    for (size_t i = 0; i < of_camera.size(); ++i) corners->upright[of_camera[i]] = upright[i];
  }
}

}  // namespace raysfm
