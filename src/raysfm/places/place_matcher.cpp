#include "raysfm/places/place_matcher.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "raysfm/scene/map_measures.h"

namespace raysfm {
namespace {

constexpr float kMaxRatio = 0.85f;  // of the distances to the nearest descriptor and to the next
constexpr int kMinMatches = 12;     // no pose that is sure comes from fewer
constexpr int kMinMatchesEnd = 10;  // where track ended, what the pose leads to tells the more
constexpr double kCornerError = 4;  // standard deviations, which are pixels of the octave
// Once a pose is there: how far a corner may be from where it sees a point, as a part of the image's longer
// side, and the bits by which the two may differ.
constexpr float kGuideShare = 0.012f;
constexpr int kMostDifferent = 70, kMostDifferentUpright = 60;
constexpr double kRivalShare = 0.3;  // of the matches that agree with a pose, which another explains
constexpr int kNeighbours = 4;       // key frames beside that of the place whose points are looked for
// Corners stand in groups: so many times more often than in a picture of dots is another one where a wrong
// match would have to be.
constexpr double kClustering = 10;
constexpr int kCellsAcross = 24;  // agreement within one cell of the image counts once

// Aside, where points are looked for that are not there: so many times as far as they may be from their
// place.
constexpr float kAside = 3;

// At the sizes at which they look most alike.
int least_distance(const UprightDescriptor& a, const UprightDescriptor& b) {
  int least = distance(a[0], b[0]);
  for (int i = 1; i < kUprightSizes * kUprightSizes; ++i) {
    least = std::min(least, distance(a[i / kUprightSizes], b[i % kUprightSizes]));
  }
  return least;
}

// Key frames with descriptors that share most points with one, that one first.
std::vector<int> described_about(const Map& map, int keyframe) {
  std::vector<std::pair<int, int>> shared;  // (minus points, key frame)
  const std::vector<int> count = shared_observations(map, keyframe);
  for (int k = 0; k < static_cast<int>(count.size()); ++k) {
    if (k != keyframe && count[k] > 0 && !map.keyframes[k].described.empty())
      shared.push_back({-count[k], k});
  }
  std::ranges::sort(shared);
  shared.resize(std::min<size_t>(shared.size(), kNeighbours));
  std::vector<int> keyframes{keyframe};
  for (const auto& [points, k] : shared) keyframes.push_back(k);
  return keyframes;
}

double log10_choose(int n, int k) {
  double sum = 0;
  for (int i = 1; i <= k; ++i) sum += std::log10(double(n - k + i) / i);
  return sum;
}

}  // namespace

ImageCell cell_of(const TrackingRig& rig, int camera, const Eigen::Vector2f& pixel) {
  const float side = static_cast<float>(rig.camera(camera).longer_side()) / kCellsAcross;
  return {camera, static_cast<int>(pixel.x() / side), static_cast<int>(pixel.y() / side)};
}

double log10_chance_poses(int matches, int agreeing, double chance, int sample) {
  if (agreeing <= sample) return 0;
  return std::log10(double(matches)) + log10_choose(matches, agreeing) + log10_choose(agreeing, sample) +
         (agreeing - sample) * std::log10(chance);
}

// What looks alike, wherever it is.
void PlaceMatcher::match(const DescribedCorners& seen, const Map& map, int keyframe) {
  const MapKeyFrame& k = map.keyframes[keyframe];
  match_descriptors(k.descriptors, seen.descriptors, kMaxRatio, &alike_);
  matches_.clear();
  for (const DescriptorMatch& m : alike_) {
    const int track = k.tracks[k.described[m.query]];
    if (track >= 0 && map.tracks[track].triangulated) matches_.push_back({m.train, track});
  }
}

void PlaceMatcher::match(const DescribedCorners& seen, const Map& map, const TrackEnd& end) {
  match_descriptors(end.upright, seen.upright, kMaxRatio, &alike_);
  matches_.clear();
  for (const DescriptorMatch& m : alike_) {
    const int track = end.corners[m.query].track;
    if (map.tracks[track].triangulated) matches_.push_back({m.train, track});
  }
}

PoseObservations PlaceMatcher::observations(const DescribedCorners& seen, const Map& map) {
  points_.clear();
  pixels_.clear();
  cameras_.clear();
  rays_.clear();
  sigmas_.clear();
  std::erase_if(matches_, [&](const CornerOfTrack& m) {
    const TrackPixel& corner = seen.corners[m.corner];
    if (rig_.angular()) {
      ObservedRay ray;
      if (!rig_.observe(corner.camera, corner.pixel, &ray)) return true;
      rays_.push_back(ray);
    }
    points_.push_back(map.tracks[m.track].position);
    pixels_.push_back(corner.pixel.cast<double>());
    cameras_.push_back(corner.camera);
    sigmas_.push_back(octave_side(corner.octave));
    return false;
  });
  return {points_, pixels_, cameras_, rays_, sigmas_};
}

// Keeps the matches that agree with the pose, and returns the others.
std::vector<CornerOfTrack> PlaceMatcher::keep_inliers() {
  std::vector<CornerOfTrack> others;
  size_t kept = 0;
  for (size_t i = 0; i < matches_.size(); ++i) {
    if (estimate_.inlier[i]) {
      matches_[kept++] = matches_[i];
    } else {
      others.push_back(matches_[i]);
    }
  }
  matches_.resize(kept);
  return others;
}

// Whether another pose explains a good part of what the first left over: the place repeats itself, as a
// checkerboard does, and neither can be believed.
bool PlaceMatcher::has_rival(const DescribedCorners& seen, const Map& map, const PoseOptions& options,
                             std::vector<CornerOfTrack> others) {
  const auto agreeing = static_cast<double>(matches_.size());
  if (static_cast<double>(others.size()) < std::max<double>(kMinMatches, kRivalShare * agreeing))
    return false;
  std::swap(matches_, others);
  estimator_.estimate(rig_.rig(), observations(seen, map), nullptr, options, &rival_);
  std::swap(matches_, others);
  return rival_.ok() && rival_.inlier_count >= kRivalShare * agreeing;
}

void PlaceMatcher::begin_to_look(const DescribedCorners& seen, const Map& map, bool aside_too) {
  grids_.resize(rig_.size());
  corners_of_camera_.resize(rig_.size());
  for (int c = 0; c < rig_.size(); ++c) {
    corners_of_camera_[c].clear();
    std::vector<Eigen::Vector2f> pixels;
    for (size_t i = 0; i < seen.corners.size(); ++i) {
      if (seen.corners[i].camera != c) continue;
      corners_of_camera_[c].push_back(static_cast<int>(i));
      pixels.push_back(seen.corners[i].pixel);
    }
    grids_[c].build(pixels, rig_.camera(c).width, rig_.camera(c).height);
  }
  matches_.clear();
  search_ = {aside_too, {}, {}};
  corner_taken_.assign(seen.corners.size(), 0);
  track_taken_.assign(map.tracks.size(), 0);
}

// The corner about a pixel that looks most like a point, of those that look like it at all; -1: there is
// none.
template <typename Differing>
int PlaceMatcher::nearest_corner(int camera, const Eigen::Vector2d& pixel, int most,
                                 const Differing& differing) const {
  const float radius = kGuideShare * static_cast<float>(rig_.camera(camera).longer_side());
  int best = -1, best_distance = most + 1;
  grids_[camera].for_each_in(pixel.cast<float>(), radius, [&](int j) {
    const int corner = corners_of_camera_[camera][j];
    const int bits = differing(corner);
    if (corner_taken_[corner] || bits >= best_distance) return;
    best = corner;
    best_distance = bits;
  });
  return best;
}

// Whether there is something like a point where it is not.
template <typename Differing>
void PlaceMatcher::look_aside(int camera, const Eigen::Vector2d& pixel, int most,
                              const Differing& differing) {
  const ImageCell cell = cell_of(rig_, camera, pixel.cast<float>());
  search_.looked_for.insert(cell);
  for (int side = 0; side < 4; ++side) {
    const double far = kAside * kGuideShare * rig_.camera(camera).longer_side() * (side % 2 == 0 ? 1 : -1);
    const Eigen::Vector2d aside = pixel + (side < 2 ? Eigen::Vector2d(far, 0) : Eigen::Vector2d(0, far));
    if (nearest_corner(camera, aside, most, differing) >= 0) search_.aside[side].insert(cell);
  }
}

// Looks for a point where a pose sees it.
template <typename Differing>
void PlaceMatcher::look_for(const Map& map, int track, const Rigid3& rig_from_world, int most,
                            const Differing& differing) {
  if (track < 0 || track_taken_[track] || !map.tracks[track].triangulated) return;
  const Eigen::Vector3d point = rig_from_world * map.tracks[track].position;
  int best = -1, best_distance = most + 1;
  for (int c = 0; c < rig_.size(); ++c) {
    Eigen::Vector2d pixel;
    if (!rig_.see(c, rig_.cam_from_rig(c) * point, &pixel)) continue;
    if (search_.aside_too) look_aside(c, pixel, most, differing);
    const int corner = nearest_corner(c, pixel, most, differing);
    if (corner < 0 || differing(corner) >= best_distance) continue;
    best = corner;
    best_distance = differing(corner);
  }
  if (best < 0) return;
  corner_taken_[best] = track_taken_[track] = 1;
  matches_.push_back({best, track});
}

// The points of the place and of those beside it.
void PlaceMatcher::look_about(const DescribedCorners& seen, const Map& map, int keyframe,
                              const Rigid3& rig_from_world) {
  begin_to_look(seen, map, false);
  for (const int n : described_about(map, keyframe)) {
    const MapKeyFrame& k = map.keyframes[n];
    for (size_t i = 0; i < k.described.size(); ++i) {
      look_for(map, k.tracks[k.described[i]], rig_from_world, kMostDifferent,
               [&](int corner) { return distance(seen.descriptors[corner], k.descriptors[i]); });
    }
  }
}

void PlaceMatcher::look_about(const DescribedCorners& seen, const Map& map, const TrackEnd& end,
                              const Rigid3& rig_from_world) {
  begin_to_look(seen, map, true);
  for (size_t i = 0; i < end.corners.size(); ++i) {
    look_for(map, end.corners[i].track, rig_from_world, kMostDifferentUpright,
             [&](int corner) { return least_distance(seen.upright[corner], end.upright[i]); });
  }
}

std::set<ImageCell> PlaceMatcher::cells_of_matches(const DescribedCorners& seen) const {
  std::set<ImageCell> cells;
  for (const CornerOfTrack& m : matches_) {
    const TrackPixel& corner = seen.corners[m.corner];
    cells.insert(cell_of(rig_, corner.camera, corner.pixel));
  }
  return cells;
}

// Of the matches that agree, among `matched` that were made without knowing where to look.
double PlaceMatcher::log10_false_alarms(const DescribedCorners& seen, int matched) const {
  double chance = 0;
  for (const CornerOfTrack& m : matches_) {
    const TrackPixel& corner = seen.corners[m.corner];
    const Camera& camera = rig_.camera(corner.camera);
    const double radius = kCornerError * octave_side(corner.octave);
    chance += kClustering * std::numbers::pi * radius * radius / (double(camera.width) * camera.height);
  }
  const auto agreeing = static_cast<int>(cells_of_matches(seen).size());
  return log10_chance_poses(matched, agreeing, std::min(0.5, chance / static_cast<double>(matches_.size())));
}

// How likely it is that points are found in so many cells where a pose is wrong, of those where they were
// looked for, all but `known`, which the pose is from. They would be found as often as aside, where they are
// not.
double PlaceMatcher::log10_found_by_chance(const std::set<ImageCell>& known,
                                           const std::set<ImageCell>& all_found) const {
  const auto count = [&](const std::set<ImageCell>& cells) {
    return static_cast<int>(
        std::ranges::count_if(cells, [&](const ImageCell& c) { return !known.contains(c); }));
  };
  const int looked_for = count(search_.looked_for), found = std::min(count(all_found), looked_for);
  int aside = 1;  // never is nothing found there
  for (const std::set<ImageCell>& side : search_.aside) aside += count(side);
  const double chance = aside / (4.0 * looked_for);
  if (found <= chance * looked_for) return 0;
  return std::min(0.0, log10_choose(looked_for, found) + found * std::log10(chance));
}

std::optional<RecognisedPlace> PlaceMatcher::recognise(const DescribedCorners& seen, const Map& map,
                                                       int keyframe, uint64_t seed, uint64_t stream) {
  match(seen, map, keyframe);
  std::optional<RecognisedPlace> place =
      find_pose(seen, map, seed, stream, kMinMatches,
                [&](const Rigid3& rig_from_world) { look_about(seen, map, keyframe, rig_from_world); });
  if (place) place->keyframe = keyframe;
  return place;
}

std::optional<RecognisedPlace> PlaceMatcher::recognise(const DescribedCorners& seen, const Map& map,
                                                       const TrackEnd& end, uint64_t seed, uint64_t stream) {
  match(seen, map, end);
  std::set<ImageCell> known;
  std::optional<RecognisedPlace> place =
      find_pose(seen, map, seed, stream, kMinMatchesEnd, [&](const Rigid3& rig_from_world) {
        known = cells_of_matches(seen);
        look_about(seen, map, end, rig_from_world);
      });
  if (!place) return std::nullopt;
  const std::set<ImageCell> found = cells_of_matches(seen);
  place->keyframe = end.keyframe;
  place->log10_false_alarms += log10_found_by_chance(known, found);
  const size_t looked_for = search_.looked_for.size();
  // Where nothing was left to be looked for, nothing more speaks for the pose.
  if (looked_for > 0)
    place->found = static_cast<double>(std::min(found.size(), looked_for)) / static_cast<double>(looked_for);
  return place;
}

// From the matches; `look_about` makes more of them once there is a first pose.
template <typename LookAbout>
std::optional<RecognisedPlace> PlaceMatcher::find_pose(const DescribedCorners& seen, const Map& map,
                                                       uint64_t seed, uint64_t stream, int least,
                                                       const LookAbout& look_about) {
  const auto matched = static_cast<int>(matches_.size());
  if (matched < least) return std::nullopt;
  const PoseOptions options{
      .max_error_px = kCornerError, .min_inliers = least, .seed = seed, .stream = stream};
  estimator_.estimate(rig_.rig(), observations(seen, map), nullptr, options, &estimate_);
  if (!estimate_.ok()) return std::nullopt;
  std::vector<CornerOfTrack> others = keep_inliers();
  if (has_rival(seen, map, options, std::move(others))) return std::nullopt;
  RecognisedPlace place;
  place.log10_false_alarms = log10_false_alarms(seen, matched);

  look_about(estimate_.rig_from_world);
  const PoseObservations all = observations(seen, map);
  estimate_.inlier.assign(matches_.size(), 1);
  estimator_.refine(rig_.rig(), all, options, &estimate_);
  if (!estimate_.ok()) return std::nullopt;
  keep_inliers();
  place.rig_from_world = estimate_.rig_from_world;
  place.covariance = estimate_.covariance;
  place.matches = matches_;
  return place;
}

}  // namespace raysfm
