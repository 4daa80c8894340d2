#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/saved_map/saved_map.h"

namespace raysfm {
namespace {

// What is wrong, empty where nothing is.
using Complaint = std::string;

constexpr double kUnit = 1e-6;  // by which the length of what has length 1 may differ
constexpr double kMostLength = 1e12;
constexpr int kMostOctave = 30;

bool is_number(double x) {
  return std::abs(x) <= kMostLength;
}  // false for NaN

bool is_place(const Eigen::Vector3d& x) {
  return x.array().abs().maxCoeff() <= kMostLength && x.allFinite();
}

bool is_pose(const Rigid3& pose) {
  return std::abs(pose.rotation.norm() - 1) <= kUnit && is_place(pose.translation);
}

bool is_ray(const ObservedRay& ray) {
  return is_place(ray.origin) && std::abs(ray.direction.norm() - 1) <= kUnit && ray.tangents.allFinite();
}

// Features may lie somewhat outside of the image.
bool is_pixel(const Eigen::Vector2f& pixel, const Camera& camera) {
  const auto near = [](float x, int size) { return x >= -size && x <= 2.0f * size; };
  return near(pixel.x(), camera.width) && near(pixel.y(), camera.height);
}

Complaint complain_of_feature(const MapKeyFrame& k, int f, const Map& map, const Rig& rig) {
  const int cameras = static_cast<int>(rig.cameras.size()), tracks = static_cast<int>(map.tracks.size());
  if (k.cameras[f] >= cameras) return fmt::format("camera {}; allowed: 0 to {}", k.cameras[f], cameras - 1);
  if (!is_pixel(k.pixels[f], rig.cameras[k.cameras[f]])) {
    return fmt::format("pixel ({}, {}); allowed: those of the image", k.pixels[f].x(), k.pixels[f].y());
  }
  if (k.octaves[f] > kMostOctave)
    return fmt::format("octave {}; allowed: 0 to {}", k.octaves[f], kMostOctave);
  if (k.tracks[f] < -1 || k.tracks[f] >= tracks) {
    return fmt::format("track {}; allowed: -1 to {}", k.tracks[f], tracks - 1);
  }
  if (k.inliers[f] > 1) return fmt::format("inlier {}; allowed: 0 or 1", k.inliers[f]);
  if (!k.rays.empty() && !is_ray(k.rays[f]))
    return "a ray that is none; allowed: finite, direction of length 1";
  return {};
}

Complaint complain_of_descriptors(const MapKeyFrame& k) {
  if (k.described.size() != k.descriptors.size()) {
    return fmt::format("{} descriptors of {} features", k.descriptors.size(), k.described.size());
  }
  int last = -1;
  for (const int f : k.described) {
    if (f <= last || f >= k.size()) {
      return fmt::format("descriptor of feature {}; allowed: ascending, below {}", f, k.size());
    }
    last = f;
  }
  return {};
}

Complaint complain_of_keyframe(const MapKeyFrame& k, const KeyFrameSource& source, const Map& map,
                               const Rig& rig) {
  if (k.frame < 0 || k.frame == INT32_MAX) return fmt::format("frame {}; allowed: from 0", k.frame);
  if (!is_pose(k.rig_from_world)) return "no pose; allowed: a unit quaternion, finite coordinates";
  if (!is_number(source.timestamp)) return "no timestamp; allowed: seconds";
  if (source.image.size() > kLongestImageName) {
    return fmt::format("an image's name of {} bytes; allowed: {}", source.image.size(), kLongestImageName);
  }
  const size_t n = k.pixels.size();
  if (k.cameras.size() != n || k.octaves.size() != n || k.tracks.size() != n || k.inliers.size() != n ||
      (k.rays.size() != n && !k.rays.empty())) {
    return "arrays of different sizes; allowed: one element for each feature";
  }
  for (int f = 0; f < k.size(); ++f) {
    const Complaint complaint = complain_of_feature(k, f, map, rig);
    if (!complaint.empty()) return fmt::format("feature {}: {}", f, complaint);
  }
  return complain_of_descriptors(k);
}

// Whether tracks and features name each other: each feature of a track is observed by it, once.
class ObservationCheck {
 public:
  explicit ObservationCheck(const Map& map) : map_(map) {
    for (const MapKeyFrame& k : map.keyframes) {
      first_feature_.push_back(is_expected_.size());
      for (const int track : k.tracks) is_expected_.push_back(track >= 0);
    }
  }

  Complaint complain_of_track(int t) {
    const Track& track = map_.tracks[t];
    if (track.triangulated && !is_place(track.position)) return "no position; allowed: finite coordinates";
    for (const TrackObservation& o : track.observations) {
      if (o.keyframe < 0 || o.keyframe >= static_cast<int>(map_.keyframes.size())) {
        return fmt::format("seen in key frame {}; allowed: 0 to {}", o.keyframe, map_.keyframes.size() - 1);
      }
      const MapKeyFrame& k = map_.keyframes[o.keyframe];
      const bool names_track = o.feature >= 0 && o.feature < k.size() && k.tracks[o.feature] == t;
      if (!names_track || !std::exchange(is_expected_[first_feature_[o.keyframe] + o.feature], 0)) {
        return fmt::format("seen as feature {} of key frame {}; allowed: one that names the track, once",
                           o.feature, o.keyframe);
      }
    }
    return {};
  }

  // After all tracks.
  Complaint complain_of_the_rest() const {
    const auto left = std::ranges::count(is_expected_, 1);
    return left == 0 ? "" : fmt::format("{} features name tracks that are not seen there", left);
  }

 private:
  const Map& map_;
  std::vector<size_t> first_feature_;  // by key frame
  std::vector<uint8_t> is_expected_;
};

Complaint complain_of_free_tracks(const Map& map) {
  std::vector<uint8_t> is_free(map.tracks.size(), 0);
  for (const int t : map.free_tracks) {
    if (t < 0 || t >= static_cast<int>(map.tracks.size()) || is_free[t] ||
        !map.tracks[t].observations.empty()) {
      return fmt::format("free track {}; allowed: those without observations, each once", t);
    }
    is_free[t] = 1;
  }
  return {};
}

Complaint complain_of_scale(const Map& map) {
  if (!(map.scale_sigma >= 0)) return fmt::format("scale_sigma {}; allowed: from 0", map.scale_sigma);
  if (!(map.rescaled > 0) || !std::isfinite(map.rescaled)) {
    return fmt::format("rescaled {}; allowed: above 0", map.rescaled);
  }
  if (!(map.guessed_distance >= 0) || !std::isfinite(map.guessed_distance)) {
    return fmt::format("guessed_distance {}; allowed: from 0", map.guessed_distance);
  }
  const int keyframes = static_cast<int>(map.keyframes.size());
  if (map.guessed_keyframe < -1 || map.guessed_keyframe >= keyframes) {
    return fmt::format("guessed_keyframe {}; allowed: -1 to {}", map.guessed_keyframe, keyframes - 1);
  }
  return {};
}

Complaint complain_of_world(const SavedWorld& world, const Rig& rig) {
  const Map& map = world.map;
  Complaint complaint = complain_of_scale(map);
  if (world.sources.size() != map.keyframes.size()) {
    complaint = fmt::format("{} sources of {} key frames", world.sources.size(), map.keyframes.size());
  }
  for (size_t k = 0; complaint.empty() && k < map.keyframes.size(); ++k) {
    complaint = complain_of_keyframe(map.keyframes[k], world.sources[k], map, rig);
    if (!complaint.empty()) complaint = fmt::format("key frame {}: {}", k, complaint);
  }
  if (!complaint.empty()) return complaint;
  ObservationCheck observations(map);
  for (size_t t = 0; t < map.tracks.size(); ++t) {
    complaint = observations.complain_of_track(static_cast<int>(t));
    if (!complaint.empty()) return fmt::format("track {}: {}", t, complaint);
  }
  complaint = observations.complain_of_the_rest();
  return complaint.empty() ? complain_of_free_tracks(map) : complaint;
}

Complaint complain_of_rig(const Rig& rig) {
  if (rig.cameras.empty() || rig.cameras.size() > 256) return "cameras: allowed: 1 to 256";
  for (const Camera& camera : rig.cameras) {
    if (camera.width <= 0 || camera.height <= 0) return fmt::format("{}: no size of its images", camera.name);
    if (!is_pose(camera.rig_from_cam)) return fmt::format("{}: rig_from_cam is no pose", camera.name);
  }
  return {};
}

}  // namespace

Result<void> check_saved_map(const SavedMap& map) {
  if (const Complaint complaint = complain_of_rig(map.rig); !complaint.empty()) return bad_input(complaint);
  for (size_t w = 0; w < map.worlds.size(); ++w) {
    const Complaint complaint = complain_of_world(map.worlds[w], map.rig);
    if (!complaint.empty()) return bad_input(fmt::format("world {}: {}", w, complaint));
  }
  return {};
}

}  // namespace raysfm
