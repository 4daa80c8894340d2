#include "raysfm/mapping/mapper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "raysfm/core/median.h"
#include "raysfm/views/scan_correction.h"
#include "raysfm/views/surfaces.h"

namespace raysfm {
namespace {

constexpr float kMinMapZncc = 0.75f;
// Radians. Points of little parallax make their depth up and bias what is posed by them; they are taken only
// where a key frame has too few others.
constexpr double kMinParallax = 0.02, kLeastParallax = 0.005;
constexpr int kEnoughPoints = 200;
constexpr float kSearchSlack = 3.0f;  // pixels of the octave
// Parts of the image's longer side: of the search along the epipolar line, and of the features that tell the
// depth of one without.
constexpr float kMaxSearch = 0.05f, kNeighbourhood = 0.09f;
// Cells that share a guess of the distance, in radii of the neighbourhood.
constexpr float kPriorCell = 0.5f;

// Guess of the distance of what a camera of a key frame sees, from the features that have one.
class DistancePrior {
 public:
  DistancePrior(const Map& map, int keyframe, const TrackingRig& rig, int camera) {
    const MapKeyFrame& k = map.keyframes[keyframe];
    const Eigen::Vector3d center = (k.rig_from_world.inverse() * rig.camera(camera).rig_from_cam).translation;
    std::vector<Eigen::Vector2f> pixels;
    for (int f = 0; f < k.size(); ++f) {
      if (k.tracks[f] < 0 || !k.inliers[f] || !map.tracks[k.tracks[f]].triangulated) continue;
      const double distance = (map.tracks[k.tracks[f]].position - center).norm();
      near_.push_back(distance);
      if (k.cameras[f] != camera) continue;
      pixels.push_back(k.pixels[f]);
      distances_.push_back(distance);
    }
    neighbourhood_ = kNeighbourhood * static_cast<float>(rig.camera(camera).longer_side());
    cell_ = kPriorCell * neighbourhood_;
    columns_ = static_cast<int>(static_cast<float>(rig.camera(camera).width) / cell_) + 1;
    const int rows = static_cast<int>(static_cast<float>(rig.camera(camera).height) / cell_) + 1;
    in_cell_.assign(static_cast<size_t>(columns_) * rows, kNotYet);
    grid_.build(pixels, rig.camera(camera).width, rig.camera(camera).height);
    if (!distances_.empty()) near_ = distances_;
    overall_ = median_of(&near_);
  }

  // 0 where nothing is known.
  double at(const Eigen::Vector2f& pixel) {
    const int rows = static_cast<int>(in_cell_.size()) / columns_;
    const int column = std::clamp(static_cast<int>(pixel.x() / cell_), 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(pixel.y() / cell_), 0, rows - 1);
    double& distance = in_cell_[row * columns_ + column];
    if (distance == kNotYet) {
      distance =
          about({(static_cast<float>(column) + 0.5f) * cell_, (static_cast<float>(row) + 0.5f) * cell_});
    }
    return distance;
  }

 private:
  static constexpr double kNotYet = -1;

  double about(const Eigen::Vector2f& pixel) {
    near_.clear();
    grid_.for_each_in(pixel, neighbourhood_, [&](int i) { near_.push_back(distances_[i]); });
    return near_.size() >= 3 ? median_of(&near_) : overall_;
  }

  FeatureGrid grid_;
  std::vector<double> distances_, near_;
  double overall_ = 0;
  float neighbourhood_ = 0, cell_ = 0;  // pixels
  int columns_ = 0;
  std::vector<double> in_cell_;
};

// Of the distance along a ray, where a point without one may be: it is looked for between what is seen there.
constexpr std::array kOnRay = {1.0, 0.5, 5.0};

// How far from where a camera sees the first of these points it may see the point, pixels. Infinite where it
// does not see one of them.
float reach_along_ray(const PointProjection* on_ray) {
  double reach = 0;
  for (size_t i = 0; i < kOnRay.size(); ++i) {
    if (!on_ray[i].in_image) return INFINITY;
    reach = std::max(reach, (on_ray[i].pixel - on_ray[0].pixel).norm());
  }
  return static_cast<float>(reach);
}

}  // namespace

bool observe(const TrackingRig& rig, const TrackPixel& seen, int keyframe, Map* map) {
  MapKeyFrame& k = map->keyframes[keyframe];
  if (rig.angular()) {
    ObservedRay ray;
    if (!rig.observe(seen.camera, seen.pixel, &ray)) return false;
    k.rays.push_back(ray);
  }
  map->observe(seen.track, keyframe, k.add(seen.camera, seen.pixel, seen.octave, seen.track));
  return true;
}

bool move_observation(const TrackingRig& rig, int feature, const Eigen::Vector2f& pixel, int octave,
                      MapKeyFrame* keyframe) {
  if (rig.angular() && !rig.observe(keyframe->cameras[feature], keyframe->at_instant(feature, pixel),
                                    &keyframe->rays[feature])) {
    return false;
  }
  keyframe->pixels[feature] = pixel;
  keyframe->octaves[feature] = static_cast<uint8_t>(octave);
  return true;
}

void renew_rays(const TrackingRig& rig, MapKeyFrame* keyframe) {
  keyframe->rays.resize(rig.angular() ? keyframe->pixels.size() : 0);
  for (size_t f = 0; f < keyframe->rays.size(); ++f) {
    if (!rig.observe(keyframe->cameras[f], keyframe->instant_pixel(static_cast<int>(f)), &keyframe->rays[f]))
      keyframe->inliers[f] = 0;
  }
}

void start_tracks(const TrackingRig& rig, const View& view, float spacing, int keyframe, Map* map) {
  std::vector<Eigen::Vector2f> there;
  for (int c = 0; c < rig.size(); ++c) {
    const CameraView& image = view.cameras[c];
    const MapKeyFrame& k = map->keyframes[keyframe];
    there.clear();
    for (int f = 0; f < k.size(); ++f) {
      if (k.cameras[f] == c) there.push_back(k.pixels[f]);
    }
    FeatureGrid taken;
    taken.build(there, image.width, image.height);
    for (int i = 0; i < image.features.size(); ++i) {
      const Eigen::Vector2f pixel = image.features.pixels[i];
      const uint8_t octave = image.features.octaves[i];
      bool free = true;
      taken.for_each_in(pixel, spacing * octave_side(octave), [&](int) { free = false; });
      if (!free) continue;
      const int track = map->new_track();
      map->tracks[track].rgb = image.rgb[i];
      const TrackPixel seen{track, static_cast<uint8_t>(c), octave, pixel};
      if (!observe(rig, seen, keyframe, map)) map->free_track(track);
    }
  }
}

void Mapper::add_keyframe(const ViewPtr& view, const Localisation& pose, Adjusting adjusting, Map* map,
                          std::vector<KeyFrameView>* views) {
  {
    ScopedTimer timer(keyframe_timing);
    const int anchor = static_cast<int>(map->keyframes.size()) - 1;
    const int keyframe = anchor + 1;
    MapKeyFrame& k = map->keyframes.emplace_back();
    k.frame = view->frame;
    k.rig_from_world = pose.rig_from_world;
    for (const PointMatch& m : pose.matches) observe(rig_, m, keyframe, map);
    follow_tracks(anchor, keyframe, pose.motion, *view, map, *views);
    correct_scan(rig_, pose.motion, 0, keyframe, map);
    triangulate_tracks(keyframe, map);
    complete_keyframe(view, keyframe, pose.motion, map, views);
  }
  if (is_adjustment_due(adjusting, static_cast<int>(map->keyframes.size()))) adjust_locally(map);
  refit_surfaces(*map, views);
  if (is_scale_due(static_cast<int>(map->keyframes.size()), options_.global_until)) {
    measure_scale(effort_while_growing(*map), map);
  }
}

// Those of the newest key frame, and again of what has become better known since.
void Mapper::refit_surfaces(const Map& map, std::vector<KeyFrameView>* views) {
  constexpr std::array kAges = {0, 2, 8};  // key frames
  if (!options_.departures.surfaces) return;
  ScopedTimer timer(keyframe_timing);
  const int newest = static_cast<int>(views->size()) - 1;
  for (const int age : kAges) {
    if (age <= newest && (*views)[newest - age].view)
      fit_surfaces(rig_, map, newest - age, &(*views)[newest - age]);
  }
}

void Mapper::complete_keyframe(const ViewPtr& view, int keyframe, const RigMotion& motion, Map* map,
                               std::vector<KeyFrameView>* views) {
  const int known = map->keyframes[keyframe].size();
  start_tracks(rig_, *view, kTrackSpacing, keyframe, map);
  correct_scan(rig_, motion, known, keyframe, map);
  views->push_back(make_keyframe_view(view, map->keyframes[keyframe], rig_, known));
  if (!rig_.common_views().empty()) find_across(view, keyframe, map, views);
  views->back().view = images_of(*view);
}

// Tracks without a position in the other cameras of the same instant.
void Mapper::find_across(const ViewPtr& view, int keyframe, Map* map, std::vector<KeyFrameView>* views) {
  const MapKeyFrame& k = map->keyframes[keyframe];
  std::vector<int> wanted;
  for (int f = 0; f < k.size(); ++f) {
    if (k.tracks[f] >= 0 && !map->tracks[k.tracks[f]].triangulated) wanted.push_back(f);
  }
  across_.match(rig_, views->back(), *view, wanted, &across_matches_);
  bool joined = false;
  for (const AcrossMatch& m : across_matches_) joined |= join_across(keyframe, m, map);
  if (!joined) return;
  views->back() = make_keyframe_view(view, map->keyframes[keyframe], rig_);
  triangulate_tracks(keyframe, map);
}

// Makes what another camera sees of a feature an observation of its track. A track that has only just begun
// at that place in the other camera is the same point: it ends.
bool Mapper::join_across(int keyframe, const AcrossMatch& match, Map* map) {
  MapKeyFrame& k = map->keyframes[keyframe];
  const int track = k.tracks[match.feature];
  if (track < 0) return false;  // it has just become part of another
  const float spacing = kTrackSpacing * octave_side(match.octave);
  same_place_.clear();
  for (int f = 0; f < k.size(); ++f) {
    if (k.cameras[f] != match.camera || k.tracks[f] < 0) continue;
    if ((k.pixels[f] - match.pixel).squaredNorm() >= spacing * spacing) continue;
    if (map->tracks[k.tracks[f]].observations.size() > 1) return false;  // another point, or joined already
    same_place_.push_back(f);
  }
  for (const int f : same_place_) {
    map->tracks[k.tracks[f]].observations.clear();
    k.tracks[f] = -1;
  }
  return observe(rig_,
                 {track, static_cast<uint8_t>(match.camera), static_cast<uint8_t>(match.octave), match.pixel},
                 keyframe, map);
}

void Mapper::follow_tracks(int anchor, int keyframe, const RigMotion& motion, const View& view, Map* map,
                           std::span<const KeyFrameView> views) {
  if (!views[anchor].view) return;
  for (int c = 0; c < rig_.size(); ++c) follow_in(c, anchor, keyframe, motion, view, map, views);
}

void Mapper::follow_in(int camera, int anchor, int keyframe, const RigMotion& motion, const View& view,
                       Map* map, std::span<const KeyFrameView> views) {
  const MapKeyFrame& from = map->keyframes[anchor];
  const Rigid3 target_from_anchor = rig_.cam_from_rig(camera) * map->keyframes[keyframe].rig_from_world *
                                    from.rig_from_world.inverse() * rig_.camera(camera).rig_from_cam;
  DistancePrior prior(*map, anchor, rig_, camera);
  const float max_radius = kMaxSearch * static_cast<float>(rig_.camera(camera).longer_side());
  const Eigen::Matrix3d rotation = target_from_anchor.rotation.toRotationMatrix();
  queries_.clear(), followed_.clear(), on_rays_.clear();
  for (int f = 0; f < from.size(); ++f) {
    if (from.cameras[f] != camera || from.tracks[f] < 0 || map->tracks[from.tracks[f]].triangulated) continue;
    const double distance = prior.at(from.pixels[f]);
    if (!(distance > 0)) continue;
    followed_.push_back(f);
    for (const double part : kOnRay) {
      on_rays_.push_back(rotation * point_on_ray(views[anchor], f, part * distance) +
                         target_from_anchor.translation);
    }
  }
  rig_.see(camera, on_rays_, &seen_on_rays_);
  for (size_t i = 0; i < followed_.size(); ++i) {
    const int f = followed_[i];
    const PointProjection* const on_ray = &seen_on_rays_[kOnRay.size() * i];
    PatchQuery query{.keyframe = anchor, .feature = f, .track = from.tracks[f]};
    if (!predict_patch(rig_, views[anchor], f, prior.at(from.pixels[f]), camera, rotation,
                       on_rays_[kOnRay.size() * i], *on_ray, view.cameras[camera], &query)) {
      continue;
    }
    if (rig_.scans()) {
      query.predicted +=
          predict_scan_offset(rig_, camera, rig_.camera(camera).rig_from_cam * on_rays_[kOnRay.size() * i],
                              motion, query.predicted.cast<double>());
    }
    const float slack = kSearchSlack * octave_side(query.octave);
    query.radius = std::min(max_radius, slack + reach_along_ray(on_ray));
    queries_.push_back(query);
  }
  matcher_.match(views, queries_, view, kMinMapZncc, &matches_);

  std::vector<PatchQuery> matched;
  starts_.clear();
  for (const GuidedMatch& m : matches_) {
    matched.push_back(queries_[m.query]);
    starts_.push_back(m.pixel);
  }
  matcher_.align(views, matched, starts_, view, {}, &alignments_);
  for (size_t i = 0; i < matched.size(); ++i) {
    if (!alignments_[i].converged) continue;
    observe(rig_, seen_at(matched[i], alignments_[i]), keyframe, map);
  }
}

const Mapper::WorldFromCam& Mapper::world_from_cam(const Map& map, int keyframe, int camera) {
  const size_t index = static_cast<size_t>(keyframe) * rig_.size() + camera;
  if (index >= world_from_cams_.size()) world_from_cams_.resize(map.keyframes.size() * rig_.size());
  WorldFromCam& pose = world_from_cams_[index];
  if (!pose.is_known) {
    const Rigid3 p = map.keyframes[keyframe].rig_from_world.inverse() * rig_.camera(camera).rig_from_cam;
    pose = {true, p.rotation.toRotationMatrix(), p.translation};
    known_cams_.push_back(index);
  }
  return pose;
}

void Mapper::forget_cams() {
  for (const size_t index : known_cams_) world_from_cams_[index].is_known = false;
  known_cams_.clear();
}

// The rays of a track in the world. Returns the largest standard deviation of their pixels.
float Mapper::gather_rays(const Map& map, const Track& track) {
  rays_.clear();
  float sigma = 0;
  for (const TrackObservation& o : track.observations) {
    const MapKeyFrame& k = map.keyframes[o.keyframe];
    sigma = std::max(sigma, octave_side(k.octaves[o.feature]));
    const Camera& camera = rig_.camera(k.cameras[o.feature]);
    Ray ray;
    if (!camera.ray(k.instant_pixel(o.feature).cast<double>(), &ray)) continue;
    const WorldFromCam& pose = world_from_cam(map, o.keyframe, k.cameras[o.feature]);
    rays_.push_back({pose.rotation * ray.origin + pose.translation, pose.rotation * ray.direction});
  }
  return sigma;
}

bool Mapper::triangulate_track(const Map& map, Track* track) {
  Triangulation found;
  const float sigma = gather_rays(map, *track);
  if (!triangulate(rays_, &found)) return false;
  if (found.max_angle >= kInlierError * sigma / rig_.pixels_per_radian()) return false;
  track->position = found.point;
  track->triangulated = track->had_position = true;
  return true;
}

// The parallax tells which of the tracks are worth the rest of the work: most are far away.
void Mapper::triangulate_tracks(int keyframe, Map* map) {
  int known = 0;
  candidates_.clear();
  forget_cams();
  for (const int t : map->keyframes[keyframe].tracks) {
    if (t < 0) continue;
    const Track& track = map->tracks[t];
    known += track.triangulated;
    if (track.triangulated || track.observations.size() < 2) continue;
    gather_rays(*map, track);
    const double parallax = largest_parallax(rays_);
    if (parallax >= kLeastParallax) candidates_.push_back({-parallax, t});
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(a.negative_parallax, a.track) < std::tie(b.negative_parallax, b.track);
  });
  for (const Candidate& c : candidates_) {
    const bool may_wait = options_.departures.parallax && known >= kEnoughPoints;
    if (-c.negative_parallax < kMinParallax && may_wait) break;
    Track& track = map->tracks[c.track];
    if (!triangulate_track(*map, &track)) continue;
    ++known;
    for (const TrackObservation& o : track.observations) map->keyframes[o.keyframe].inliers[o.feature] = 1;
  }
}

}  // namespace raysfm
