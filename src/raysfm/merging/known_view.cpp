#include "raysfm/merging/known_view.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// Distance of a corner from where a point is expected, and how much nearer than the next corner it must be.
constexpr double kMostOff = 3;  // pixels of the octave
constexpr double kClearlyNearer = 0.5;
constexpr size_t kLeastMatches = 30;

// Corners of a key frame by where they are.
class CornerGrid {
 public:
  explicit CornerGrid(const MapKeyFrame& keyframe) : keyframe_(keyframe) {
    for (int f = 0; f < keyframe.size(); ++f) {
      if (keyframe.tracks[f] >= 0) corners_.push_back(f);
    }
    std::ranges::sort(corners_, {}, [&](int f) { return keyframe.instant_pixel(f).y(); });
  }

  // The feature of a camera that is nearest to a pixel, near enough and clearly nearer than any other; else
  // -1.
  int nearest(int camera, const Eigen::Vector2d& pixel) const {
    const auto row = [&](int f) { return static_cast<double>(keyframe_.instant_pixel(f).y()); };
    constexpr double kReach = 64;  // pixels
    int best = -1;
    double least = kMostOff, second = HUGE_VAL;
    for (auto it = std::ranges::lower_bound(corners_, pixel.y() - kReach, {}, row);
         it != corners_.end() && row(*it) < pixel.y() + kReach; ++it) {
      if (keyframe_.cameras[*it] != camera) continue;
      const double off =
          (keyframe_.instant_pixel(*it).cast<double>() - pixel).norm() / octave_side(keyframe_.octaves[*it]);
      if (off < least) {
        second = best < 0 ? HUGE_VAL : least;
        least = off;
        best = *it;
      } else {
        second = std::min(second, off);
      }
    }
    return best >= 0 && least <= kClearlyNearer * second ? best : -1;
  }

 private:
  const MapKeyFrame& keyframe_;
  std::vector<int> corners_;  // by row
};

// Tracks with a position that some key frames see, each once.
std::vector<int> points_of(const Map& map, std::span<const int> keyframes) {
  std::vector<int> tracks;
  for (const int k : keyframes) {
    for (int f = 0; f < map.keyframes[k].size(); ++f) {
      const int track = map.keyframes[k].tracks[f];
      if (track >= 0 && map.keyframes[k].inliers[f] && map.tracks[track].triangulated)
        tracks.push_back(track);
    }
  }
  std::ranges::sort(tracks);
  tracks.erase(std::unique(tracks.begin(), tracks.end()), tracks.end());
  return tracks;
}

// Of some key frames the one that sees most of the matched tracks.
int best_witness(const Map& map, std::span<const int> keyframes, std::span<const CornerOfTrack> matches) {
  int best = keyframes[0], most = -1;
  for (const int k : keyframes) {
    const auto seen = std::ranges::count_if(matches, [&](const CornerOfTrack& m) {
      return std::ranges::any_of(map.tracks[m.track].observations,
                                 [&](const TrackObservation& o) { return o.keyframe == k; });
    });
    if (seen > most) best = k, most = static_cast<int>(seen);
  }
  return best;
}

}  // namespace

std::optional<Meeting> meet_known(const TrackingRig& rig, const Map& here, const PlaceRef& place,
                                  const Map& there, int there_world, const Rigid3& rig_from_there,
                                  std::span<const int> near) {
  if (near.empty()) return std::nullopt;
  const MapKeyFrame& keyframe = here.keyframes[place.keyframe];
  const CornerGrid grid(keyframe);
  std::vector<uint8_t> taken(keyframe.size(), 0);
  DescribedCorners seen;  // descriptors are not needed: pixels tell
  RecognisedPlace known;
  known.rig_from_world = rig_from_there;
  for (const int track : points_of(there, near)) {
    for (int c = 0; c < rig.size(); ++c) {
      Eigen::Vector2d pixel;
      const Eigen::Vector3d in_rig = rig_from_there * there.tracks[track].position;
      if (!rig.see(c, rig.cam_from_rig(c) * in_rig, &pixel)) continue;
      const int f = grid.nearest(c, pixel);
      if (f < 0 || (&here == &there && keyframe.tracks[f] == track)) continue;
      if (std::exchange(taken[f], 1)) continue;
      known.matches.push_back({static_cast<int>(seen.corners.size()), track});
      seen.corners.push_back(
          {keyframe.tracks[f], keyframe.cameras[f], keyframe.octaves[f], keyframe.pixels[f]});
      break;  // one corner for each point
    }
  }
  if (known.matches.size() < kLeastMatches) return std::nullopt;
  known.keyframe = best_witness(there, near, known.matches);
  std::optional<WorldRelation> relation =
      relate_worlds(rig, here, place.keyframe, seen, there, known, has_same_scale(rig, here, there));
  if (!relation) return std::nullopt;
  const PlaceRef other{there_world, known.keyframe};
  return Meeting{place, other, std::move(known), *std::move(relation)};
}

}  // namespace raysfm
