#include "raysfm/odometry/starter.h"

#include <fmt/format.h>

#include <algorithm>

namespace raysfm {
namespace {

constexpr double kCornerError = 2.0;  // pixels
constexpr int kMinInliers = 50;
// Right starts on real footage explain 0.6 to 0.95 of the matches, wrong ones of turning cameras under 0.5.
constexpr double kMinInlierRatio = 0.55;
// Median parallax over the rms error of the rays. Blur and a rolling shutter bend the rays of a turning
// camera into a parallax of up to 20 times their error; starts with translation have 30 and more.
constexpr double kMinSignificance = 28;
constexpr float kMinFeatureShare = 0.3f;  // M as a part of the corners, where there are few

}  // namespace

// Of many attempts the one with most matches says most about why none succeeded.
void Starter::fail(int matches, std::string reason) {
  last_reason_ = std::move(reason);
  if (matches < most_matches_) return;
  most_matches_ = matches;
  reason_ = last_reason_;
}

// M and M' of the paper stand for 1500 corners; images with fewer ask for less.
int Starter::enough(int wanted) const {
  const int corners = from_first_->base().features.size();
  return std::max(kMinInliers, std::min(wanted, static_cast<int>(kMinFeatureShare * corners * wanted / 400)));
}

void Starter::restart(int first) {
  first_ = first;
  second_ = -1;
  next_ = first + 1;
  from_first_.emplace(views_[first]);
  from_second_.reset();
}

std::optional<Start> Starter::push(ViewPtr view, Mapper& mapper) {
  views_.push_back(std::move(view));
  if (views_.size() == 1) restart(0);
  while (next_ < static_cast<int>(views_.size())) {
    if (auto start = step(mapper)) return start;
  }
  return std::nullopt;
}

std::optional<Start> Starter::step(Mapper& mapper) {
  const int current = next_++;
  const ViewPtr& view = views_[current];
  const int with_first = from_first_->advance(view);
  if (second_ < 0) {
    if (with_first >= enough(options_.min_matches)) return std::nullopt;
    second_ = std::max(current - 1, first_ + 1);
    from_second_.emplace(views_[second_]);
    if (second_ == current) return std::nullopt;
  }
  const int with_second = from_second_->advance(view);
  if (with_second >= enough(options_.min_matches) && with_first >= enough(options_.min_matches3))
    return std::nullopt;

  const int third = std::max(current - 1, second_ + 1);
  if (third > current) return std::nullopt;
  auto start = attempt(second_, third, mapper);
  if (!start) restart(second_);
  return start;
}

std::optional<Start> Starter::finish(Mapper& mapper) {
  const int last = static_cast<int>(views_.size()) - 1;
  if (last - first_ < 2) {
    if (reason_.empty()) reason_ = fmt::format("{} frames are too few, at least 3 are needed", views_.size());
    return std::nullopt;
  }
  const int second = second_ > first_ && second_ < last ? second_ : (first_ + last) / 2;
  return attempt(second, last, mapper);
}

std::optional<Start> Starter::attempt(int second, int third, Mapper& mapper) {
  ++attempts_;
  const Camera& camera = rig_.cameras[0];
  const View* views[3] = {views_[first_].get(), views_[second].get(), views_[third].get()};
  const std::vector<int>* matches[2] = {&from_first_->matches(second - first_ - 1),
                                        &from_first_->matches(third - first_ - 1)};
  std::vector<int> tracked;
  std::vector<Eigen::Vector3d> bearings[3];
  for (int f = 0; f < views[0]->features.size(); ++f) {
    const int features[3] = {f, (*matches[0])[f], (*matches[1])[f]};
    if (features[1] < 0 || features[2] < 0) continue;
    Ray rays[3];
    bool ok = true;
    for (int v = 0; v < 3 && ok; ++v) {
      ok = camera.ray(views[v]->features.pixels[features[v]].cast<double>(), &rays[v]);
    }
    if (!ok) continue;
    for (int v = 0; v < 3; ++v) bearings[v].push_back(rays[v].direction);
    tracked.push_back(f);
  }
  ThreeViewOptions options;
  options.max_error = kCornerError / camera.pixels_per_radian();
  options.min_inliers = kMinInliers;
  options.min_inlier_ratio = kMinInlierRatio;
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(views[0]->frame);
  const ThreeViewStart geometry = start_from_three_views(bearings[0], bearings[1], bearings[2], options);
  if (!geometry.ok()) {
    fail(static_cast<int>(tracked.size()), fmt::format("frames {}, {}, {}: {}", views[0]->frame,
                                                       views[1]->frame, views[2]->frame, describe(geometry)));
    return std::nullopt;
  }
  const double significance = geometry.median_parallax / std::max(geometry.rms_error, 1e-9);
  if (significance < kMinSignificance) {
    fail(static_cast<int>(tracked.size()),
         fmt::format("frames {}, {}, {}: too little translation: the parallax is only {:.0f} times the error",
                     views[0]->frame, views[1]->frame, views[2]->frame, significance));
    return std::nullopt;
  }
  return build(second, third, tracked, geometry, mapper);
}

std::optional<Start> Starter::build(int second, int third, const std::vector<int>& tracked,
                                    const ThreeViewStart& geometry, Mapper& mapper) {
  const Camera& camera = rig_.cameras[0];
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  const int indices[3] = {first_, second, third};
  const Rigid3 cam_from_world[3] = {cam_from_rig, geometry.cam1_from_cam0 * cam_from_rig,
                                    geometry.cam2_from_cam0 * cam_from_rig};
  Start start;
  Map& map = start.map;
  std::vector<int> corner_of_track;  // feature of the first view
  for (int v = 0; v < 3; ++v) {
    map.keyframes.emplace_back();
    map.keyframes[v].frame = views_[indices[v]]->frame;
    map.keyframes[v].rig_from_world = camera.rig_from_cam * cam_from_world[v];
  }
  for (size_t i = 0; i < tracked.size(); ++i) {
    if (!geometry.inlier[i]) continue;
    const int track = static_cast<int>(map.tracks.size());
    corner_of_track.push_back(tracked[i]);
    map.tracks.push_back({camera.rig_from_cam * geometry.points_in_cam0[i], true, {}, {}});
    map.tracks.back().rgb = color_at(*views_[first_], views_[first_]->features.pixels[tracked[i]]);
    for (int v = 0; v < 3; ++v) {
      const int feature = v == 0 ? tracked[i] : from_first_->matches(indices[v] - first_ - 1)[tracked[i]];
      map.observe(track, v, map.keyframes[v].add(views_[indices[v]]->features.pixels[feature], track));
    }
  }
  for (int v = 0; v < 3; ++v)
    start.views.push_back(make_keyframe_view(views_[indices[v]], map.keyframes[v], camera));
  refine_pixels(&start);
  mapper.adjust_globally(&map);
  const int points = static_cast<int>(
      std::count_if(map.tracks.begin(), map.tracks.end(), [](const Track& t) { return t.triangulated; }));
  if (points < kMinInliers) {
    fail(static_cast<int>(tracked.size()),
         fmt::format("frames {}, {}, {}: {} of {} points survive the adjustment", map.keyframes[0].frame,
                     map.keyframes[1].frame, map.keyframes[2].frame, points, map.tracks.size()));
    return std::nullopt;
  }
  start.first_view = first_;
  for (int k = 0; k < from_first_->views(); ++k) {
    std::vector<TrackPixel>& seen = start.seen.emplace_back();
    const std::vector<int>& matches = from_first_->matches(k);
    for (size_t t = 0; t < map.tracks.size(); ++t) {
      const int match = map.tracks[t].triangulated ? matches[corner_of_track[t]] : -1;
      if (match < 0) continue;
      seen.push_back({static_cast<int>(t), views_[first_ + 1 + k]->features.pixels[match]});
    }
  }
  add_points(indices, &start, mapper);
  start.summary = {
      "five-point", {map.keyframes[0].frame, map.keyframes[1].frame, map.keyframes[2].frame}, points};
  return start;
}

// The remaining corners of the three views, matched along their epipolar lines now that these are known.
void Starter::add_points(const int (&indices)[3], Start* start, Mapper& mapper) {
  Map& map = start->map;
  for (int v = 0; v < 3; ++v) {
    const ViewPtr& view = views_[indices[v]];
    if (v > 0) {
      mapper.follow_tracks(v - 1, v, *view, &map, start->views);
      mapper.triangulate_tracks(v, &map);
    }
    start_tracks(*view, kTrackSpacing, v, &map);
    start->views[v] = make_keyframe_view(view, map.keyframes[v], rig_.cameras[0]);
  }
  mapper.adjust_globally(&map);
}

// With the geometry known the patches of the first view can be shaped as the others see them, and the corners
// replaced by sub-pixel places.
void Starter::refine_pixels(Start* start) {
  const Camera& camera = rig_.cameras[0];
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  Map& map = start->map;
  const Rigid3 world_from_first = map.keyframes[0].rig_from_world.inverse() * camera.rig_from_cam;
  std::vector<PatchQuery> queries;
  std::vector<Eigen::Vector2f> starts;
  std::vector<PatchAlignment> alignments;
  for (int v = 1; v < 3; ++v) {
    MapKeyFrame& keyframe = map.keyframes[v];
    const Rigid3 target_from_first = cam_from_rig * keyframe.rig_from_world * world_from_first;
    queries.clear();
    starts.clear();
    for (const Track& track : map.tracks) {
      const int feature = track.observations[0].feature;
      PatchQuery query{.keyframe = 0, .feature = feature, .track = map.keyframes[0].tracks[feature]};
      const double distance = (track.position - world_from_first.translation).norm();
      if (!predict_patch(camera, start->views[0], feature, distance, target_from_first, &query)) continue;
      queries.push_back(query);
      starts.push_back(keyframe.pixels[track.observations[v].feature]);
    }
    matcher_.align(start->views, queries, starts, *start->views[v].view, {}, &alignments);
    for (size_t i = 0; i < queries.size(); ++i) {
      const int feature = map.tracks[queries[i].track].observations[v].feature;
      if (alignments[i].converged) keyframe.pixels[feature] = alignments[i].pixel;
      keyframe.inliers[feature] = alignments[i].converged;
    }
  }
}

}  // namespace raysfm
