#include "raysfm/merging/common_points.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "raysfm/features/octaves.h"

namespace raysfm {
namespace {

// How far from its pixel a point may be that another run has of it, pixels of the octave: runs place points
// within a third of one, and corners of a key frame are four apart.
constexpr double kMostOff = 1;
// Observations by which a point is told, and the part of all that must agree.
constexpr int kLeastAgreeing = 3;
constexpr double kAgreeingShare = 0.75;

// The tracks with a position in a key frame by where they are seen.
class SeenTracks {
 public:
  SeenTracks(const Map& map, int keyframe) : keyframe_(map.keyframes[keyframe]) {
    for (int f = 0; f < keyframe_.size(); ++f) {
      const int t = keyframe_.tracks[f];
      if (t >= 0 && keyframe_.inliers[f] && map.tracks[t].triangulated) features_.push_back(f);
    }
    std::ranges::sort(features_, {}, [&](int f) { return keyframe_.instant_pixel(f).y(); });
  }

  // Calls `found` with each of them that is near enough to a pixel of a camera.
  template <typename Found>
  void for_each_at(int camera, const Eigen::Vector2d& pixel, const Found& found) const {
    const auto row = [&](int f) { return static_cast<double>(keyframe_.instant_pixel(f).y()); };
    constexpr double kReach = 16;  // pixels: as far as the coarsest octave reaches
    for (auto it = std::ranges::lower_bound(features_, pixel.y() - kReach, {}, row);
         it != features_.end() && row(*it) < pixel.y() + kReach; ++it) {
      const Eigen::Vector2f seen = keyframe_.instant_pixel(*it);
      const double off = (seen.cast<double>() - pixel).norm() / octave_side(keyframe_.octaves[*it]);
      if (keyframe_.cameras[*it] == camera && off < kMostOff) found(keyframe_.tracks[*it]);
    }
  }

 private:
  const MapKeyFrame& keyframe_;
  std::vector<int> features_;  // by row
};

// What observations say of two tracks being one.
struct Agreement {
  int looked_at = 0, agreeing = 0;
  double off = 0;  // of those that agree, in all

  // `keyframes`: which the other run has posed.
  bool holds(size_t keyframes) const {
    const int least = std::min(kLeastAgreeing, static_cast<int>(keyframes));
    return agreeing >= least && agreeing >= kAgreeingShare * looked_at;
  }
};

std::vector<const KnownPose*> by_keyframe(const PosedByOther& of) {
  std::vector<const KnownPose*> known(of.map.keyframes.size(), nullptr);
  for (const KnownPose& pose : of.known) known[pose.keyframe] = &pose;
  return known;
}

// Whether the observations of a track show the position that another map has of it.
void look_at(const PosedByOther& of, const std::vector<const KnownPose*>& known, const Track& track,
             const TrackingRig& other_rig, const Eigen::Vector3d& position, Agreement* agreement) {
  for (const TrackObservation& o : track.observations) {
    const MapKeyFrame& k = of.map.keyframes[o.keyframe];
    if (!known[o.keyframe] || !k.inliers[o.feature]) continue;
    ++agreement->looked_at;
    const int camera = k.cameras[o.feature];
    Eigen::Vector2d pixel;
    const Eigen::Vector3d in_rig = known[o.keyframe]->rig_from_other * position;
    if (!other_rig.find(camera, other_rig.cam_from_rig(camera) * in_rig, &pixel)) continue;
    const double off =
        (k.instant_pixel(o.feature).cast<double>() - pixel).norm() / octave_side(k.octaves[o.feature]);
    if (!(off < kMostOff)) continue;
    ++agreement->agreeing;
    agreement->off += off;
  }
}

// Tracks with a position that a map's key frames see which the other run has posed, each once; all, where it
// has posed none.
std::vector<int> tracks_in(const PosedByOther& of) {
  std::vector<int> tracks;
  for (int t = 0; of.known.empty() && t < static_cast<int>(of.map.tracks.size()); ++t) {
    if (of.map.tracks[t].triangulated) tracks.push_back(t);
  }
  for (const KnownPose& pose : of.known) {
    const MapKeyFrame& k = of.map.keyframes[pose.keyframe];
    for (int f = 0; f < k.size(); ++f) {
      if (k.tracks[f] >= 0 && k.inliers[f] && of.map.tracks[k.tracks[f]].triangulated)
        tracks.push_back(k.tracks[f]);
    }
  }
  std::ranges::sort(tracks);
  tracks.erase(std::unique(tracks.begin(), tracks.end()), tracks.end());
  return tracks;
}

// Pairs of a track of `here` and one of `there` which is expected where the first is seen.
void add_candidates(const PosedByOther& here, const PosedByOther& there, bool is_swapped,
                    std::vector<std::pair<int, int>>* pairs) {
  const std::vector<int> of_there = tracks_in(there);
  for (const KnownPose& pose : here.known) {
    const SeenTracks seen(here.map, pose.keyframe);
    for (const int t : of_there) {
      const Eigen::Vector3d in_rig = pose.rig_from_other * there.map.tracks[t].position;
      for (int c = 0; c < there.rig.size(); ++c) {
        Eigen::Vector2d pixel;
        if (!there.rig.see(c, there.rig.cam_from_rig(c) * in_rig, &pixel)) continue;
        seen.for_each_at(c, pixel, [&](int track) {
          pairs->push_back(is_swapped ? std::pair(t, track) : std::pair(track, t));
        });
      }
    }
  }
}

}  // namespace

std::vector<CommonPoint> find_common_points(const PosedByOther& a, const PosedByOther& b) {
  std::vector<std::pair<int, int>> pairs;
  add_candidates(a, b, false, &pairs);
  add_candidates(b, a, true, &pairs);
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());

  const std::vector<const KnownPose*> known_of_a = by_keyframe(a), known_of_b = by_keyframe(b);
  std::vector<std::tuple<int, double, int, int>> held;  // the best first
  for (const auto& [of_a, of_b] : pairs) {
    const Track &x = a.map.tracks[of_a], &y = b.map.tracks[of_b];
    Agreement agreement;
    look_at(a, known_of_a, x, b.rig, y.position, &agreement);
    look_at(b, known_of_b, y, a.rig, x.position, &agreement);
    if (agreement.holds(a.known.size() + b.known.size()))
      held.push_back({-agreement.agreeing, agreement.off, of_a, of_b});
  }
  std::ranges::sort(held);
  std::vector<uint8_t> taken_of_a(a.map.tracks.size(), 0), taken_of_b(b.map.tracks.size(), 0);
  std::vector<CommonPoint> common;
  for (const auto& [agreeing, off, of_a, of_b] : held) {
    if (taken_of_a[of_a] || taken_of_b[of_b]) continue;
    taken_of_a[of_a] = taken_of_b[of_b] = 1;
    common.push_back({a.map.tracks[of_a].observations[0], b.map.tracks[of_b].observations[0]});
  }
  return common;
}

}  // namespace raysfm
