#include "raysfm/odometry/mapper.h"

#include <algorithm>
#include <tuple>

#include "raysfm/bundle/local_bundle.h"

namespace raysfm {
namespace {

constexpr float kMinZncc = 0.75f;
// Radians. Points of little parallax make their depth up and bias what is posed by them; they are taken only
// where a key frame has too few others.
constexpr double kMinParallax = 0.02, kLeastParallax = 0.005;
constexpr int kEnoughPoints = 200;
constexpr double kLeastDecrease = 1e-4;  // of the cost: where an adjustment stops
constexpr int kMinShared = 10;           // points that make an older key frame part of the window
constexpr int kMaxOlder = 20;
constexpr double kInlierError = 2.0;       // pixels
constexpr float kMaxSearchRadius = 40.0f;  // pixels along the epipolar line
constexpr float kNeighbourhood = 60.0f;    // pixels: features that tell the depth of one without

// Guess of the distance of the features of a key frame, from those that have one.
class DistancePrior {
 public:
  DistancePrior(const Map& map, int keyframe, const Camera& camera) {
    const MapKeyFrame& k = map.keyframes[keyframe];
    const Eigen::Vector3d center = (k.rig_from_world.inverse() * camera.rig_from_cam).translation;
    std::vector<Eigen::Vector2f> pixels;
    for (int f = 0; f < k.size(); ++f) {
      if (k.tracks[f] < 0 || !k.inliers[f] || !map.tracks[k.tracks[f]].triangulated) continue;
      pixels.push_back(k.pixels[f]);
      distances_.push_back((map.tracks[k.tracks[f]].position - center).norm());
    }
    grid_.build(pixels, camera.width, camera.height);
    near_ = distances_;
    overall_ = median();
  }

  // 0 where nothing is known.
  double at(const Eigen::Vector2f& pixel) {
    near_.clear();
    grid_.for_each_in(pixel, kNeighbourhood, [&](int i) { near_.push_back(distances_[i]); });
    return near_.size() >= 3 ? median() : overall_;
  }

 private:
  double median() {
    if (near_.empty()) return 0;
    std::nth_element(near_.begin(), near_.begin() + near_.size() / 2, near_.end());
    return near_[near_.size() / 2];
  }

  FeatureGrid grid_;
  std::vector<double> distances_, near_;
  double overall_ = 0;
};

}  // namespace

void start_tracks(const View& view, float spacing, int keyframe, Map* map) {
  MapKeyFrame& k = map->keyframes[keyframe];
  FeatureGrid taken;
  taken.build(k.pixels, view.image.width(), view.image.height());
  for (const Eigen::Vector2f& pixel : view.features.pixels) {
    bool free = true;
    taken.for_each_in(pixel, spacing, [&](int) { free = false; });
    if (!free) continue;
    const int track = static_cast<int>(map->tracks.size());
    map->tracks.emplace_back().rgb = color_at(view, pixel);
    map->observe(track, keyframe, k.add(pixel, track));
  }
}

void Mapper::add_keyframe(const ViewPtr& view, const Localisation& pose, Map* map,
                          std::vector<KeyFrameView>* views) {
  {
    ScopedTimer timer(keyframe_timing);
    const int anchor = static_cast<int>(map->keyframes.size()) - 1;
    const int keyframe = anchor + 1;
    MapKeyFrame& k = map->keyframes.emplace_back();
    k.frame = view->frame;
    k.rig_from_world = pose.rig_from_world;
    for (const PointMatch& m : pose.matches) map->observe(m.track, keyframe, k.add(m.pixel, m.track));
    follow_tracks(anchor, keyframe, *view, map, *views);
    triangulate_tracks(keyframe, map);
    start_tracks(*view, kTrackSpacing, keyframe, map);
    views->push_back(make_keyframe_view(view, map->keyframes[keyframe], rig_.cameras[0]));
  }
  adjust_locally(map);
}

void Mapper::follow_tracks(int anchor, int keyframe, const View& view, Map* map,
                           std::span<const KeyFrameView> views) {
  const Camera& camera = rig_.cameras[0];
  const MapKeyFrame& from = map->keyframes[anchor];
  const Rigid3 target_from_anchor = camera.rig_from_cam.inverse() * map->keyframes[keyframe].rig_from_world *
                                    from.rig_from_world.inverse() * camera.rig_from_cam;
  DistancePrior prior(*map, anchor, camera);
  queries_.clear();
  for (int f = 0; f < from.size(); ++f) {
    const int track = from.tracks[f];
    if (track < 0 || map->tracks[track].triangulated) continue;
    const double distance = prior.at(from.pixels[f]);
    PatchQuery query{.keyframe = anchor, .feature = f, .track = track};
    if (!(distance > 0) || !predict_patch(camera, views[anchor], f, distance, target_from_anchor, &query))
      continue;
    PatchQuery nearer, farther;
    query.radius = kMaxSearchRadius;
    if (predict_patch(camera, views[anchor], f, 0.5 * distance, target_from_anchor, &nearer) &&
        predict_patch(camera, views[anchor], f, 5.0 * distance, target_from_anchor, &farther)) {
      const float reach =
          std::max((nearer.predicted - query.predicted).norm(), (farther.predicted - query.predicted).norm());
      query.radius = std::min(kMaxSearchRadius, 3.0f + reach);
    }
    queries_.push_back(query);
  }
  matcher_.match(views, queries_, view, kMinZncc, &matches_);

  std::vector<PatchQuery> matched;
  starts_.clear();
  for (const GuidedMatch& m : matches_) {
    matched.push_back(queries_[m.query]);
    starts_.push_back(m.pixel);
  }
  matcher_.align(views, matched, starts_, view, {}, &alignments_);
  MapKeyFrame& to = map->keyframes[keyframe];
  for (size_t i = 0; i < matched.size(); ++i) {
    if (!alignments_[i].converged) continue;
    map->observe(matched[i].track, keyframe, to.add(alignments_[i].pixel, matched[i].track));
  }
}

bool Mapper::triangulate_track(const Map& map, const Track& track, Triangulation* result) {
  const Camera& camera = rig_.cameras[0];
  rays_.clear();
  for (const TrackObservation& o : track.observations) {
    const MapKeyFrame& k = map.keyframes[o.keyframe];
    Ray ray;
    if (!camera.ray(k.pixels[o.feature].cast<double>(), &ray)) continue;
    const Rigid3 world_from_cam = k.rig_from_world.inverse() * camera.rig_from_cam;
    rays_.push_back({world_from_cam * ray.origin, world_from_cam.rotation * ray.direction});
  }
  // Most tracks without a position are far away; their parallax tells it at once.
  double largest = 0;
  for (const Ray& ray : rays_)
    largest = std::max(largest, (ray.direction - rays_[0].direction).squaredNorm());
  if (largest < kLeastParallax * kLeastParallax) return false;
  return triangulate(rays_, result) && result->max_angle < kInlierError / camera.pixels_per_radian();
}

void Mapper::triangulate_tracks(int keyframe, Map* map) {
  const MapKeyFrame& seen_from = map->keyframes[keyframe];
  int known = 0;
  candidates_.clear();
  for (const int t : seen_from.tracks) {
    if (t < 0) continue;
    known += map->tracks[t].triangulated;
    Triangulation result;
    if (map->tracks[t].triangulated || map->tracks[t].observations.size() < 2) continue;
    if (!triangulate_track(*map, map->tracks[t], &result) || result.parallax < kLeastParallax) continue;
    candidates_.push_back({-result.parallax, t, result.point});
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(a.negative_parallax, a.track) < std::tie(b.negative_parallax, b.track);
  });
  for (const Candidate& c : candidates_) {
    if (-c.negative_parallax < kMinParallax && known >= kEnoughPoints) break;
    ++known;
    Track& track = map->tracks[c.track];
    track.position = c.point;
    track.triangulated = true;
    for (const TrackObservation& o : track.observations) map->keyframes[o.keyframe].inliers[o.feature] = 1;
  }
}

// The newest key frames from `first_observed`, and older ones that see many of the window's points: a place
// seen again ties the window to where it was first.
void Mapper::choose_window(const Map& map, int first_observed) {
  const int count = static_cast<int>(map.keyframes.size());
  std::vector<int> shared(count, 0);
  for (const int t : window_tracks_) {
    for (const TrackObservation& o : map.tracks[t].observations) ++shared[o.keyframe];
  }
  std::vector<std::pair<int, int>> older;  // (points, key frame)
  for (int k = 0; k < first_observed; ++k) {
    if (shared[k] >= kMinShared) older.push_back({shared[k], k});
  }
  std::sort(older.begin(), older.end(), std::greater<>());
  older.resize(std::min<size_t>(older.size(), kMaxOlder));
  window_keyframes_.clear();
  for (const auto& [points, k] : older) window_keyframes_.push_back(k);
  std::sort(window_keyframes_.begin(), window_keyframes_.end());
  for (int k = first_observed; k < count; ++k) window_keyframes_.push_back(k);
  window_pose_of_keyframe_.assign(count, -1);
  for (size_t i = 0; i < window_keyframes_.size(); ++i) {
    window_pose_of_keyframe_[window_keyframes_[i]] = static_cast<int>(i);
  }
}

void Mapper::adjust(Map* map, int first_observed, int first_free, int max_iterations) {
  const int count = static_cast<int>(map->keyframes.size());
  window_poses_.clear();
  window_free_.clear();
  window_points_.clear();
  window_tracks_.clear();
  window_observations_.clear();
  window_sources_.clear();
  window_inliers_.clear();
  window_point_of_track_.resize(map->tracks.size(), -1);
  for (int k = first_free; k < count; ++k) {
    for (const int t : map->keyframes[k].tracks) {
      if (t < 0 || !map->tracks[t].triangulated || window_point_of_track_[t] >= 0) continue;
      window_point_of_track_[t] = static_cast<int>(window_points_.size());
      window_points_.push_back(map->tracks[t].position);
      window_tracks_.push_back(t);
    }
  }
  choose_window(*map, first_observed);
  for (const int k : window_keyframes_) {
    window_poses_.push_back(map->keyframes[k].rig_from_world);
    window_free_.push_back(k >= first_free && k > 0);  // the first key frame is the world
  }
  for (const int t : window_tracks_) {
    for (const TrackObservation& o : map->tracks[t].observations) {
      const int pose = window_pose_of_keyframe_[o.keyframe];
      if (pose < 0) continue;
      const MapKeyFrame& k = map->keyframes[o.keyframe];
      window_observations_.push_back(
          {pose, window_point_of_track_[t], 0, k.pixels[o.feature].cast<double>()});
      window_sources_.push_back(o);
      window_inliers_.push_back(k.inliers[o.feature]);
    }
  }

  const BundleProblem problem{rig_.cameras, window_poses_,        window_free_,   window_points_,
                              {},           window_observations_, window_inliers_};
  const BundleOptions options{.loss = {RobustLoss::Kind::kHuber, 1.0},
                              .max_iterations = max_iterations,
                              .min_relative_decrease = kLeastDecrease};
  adjuster_.adjust_two_stage(problem, options, kInlierError);

  for (int k = first_free; k < count; ++k) {
    map->keyframes[k].rig_from_world = window_poses_[window_pose_of_keyframe_[k]];
  }
  for (size_t i = 0; i < window_tracks_.size(); ++i) {
    map->tracks[window_tracks_[i]].position = window_points_[i];
    window_point_of_track_[window_tracks_[i]] = -1;
  }
  for (size_t i = 0; i < window_sources_.size(); ++i) {
    map->keyframes[window_sources_[i].keyframe].inliers[window_sources_[i].feature] = window_inliers_[i];
  }
  // A position that fewer than two views support is no position.
  for (const int t : window_tracks_) {
    int support = 0;
    for (const TrackObservation& o : map->tracks[t].observations) {
      support += map->keyframes[o.keyframe].inliers[o.feature];
    }
    if (support < 2) map->tracks[t].triangulated = false;
  }
}

void Mapper::adjust_locally(Map* map) {
  ScopedTimer timer(adjust_timing);
  const int count = static_cast<int>(map->keyframes.size());
  const LocalWindow window =
      local_window(count, {options_.free_cameras, options_.window, options_.global_until});
  adjust(map, window.first_observed, window.first_free, 5);
}

void Mapper::adjust_globally(Map* map) {
  ScopedTimer timer(adjust_timing);
  adjust(map, 0, 0, 50);
}

}  // namespace raysfm
