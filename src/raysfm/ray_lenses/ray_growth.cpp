#include "raysfm/ray_lenses/ray_growth.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/geometry/triangulation.h"

namespace raysfm {
namespace {

constexpr Agreement kInVideo[] = {{20, 0.5}};
// Matches of photos reach far and are wrong more often: what is posed by fewer comes last.
constexpr Agreement kInPhotos[] = {{20, 0.5}, {15, 0.3}};
// Part of the observations of a photo, of points that others see as well, below which its pose is no good:
// they are 0.5 to 1 of right poses and 0.08 to 0.45 of wrong ones.
constexpr double kDoubtful = 0.45;
constexpr int kTimesDropped = 2;      // after which a photo stays out
constexpr double kLeastParallax = 2;  // of a point, in errors of an inlier at most
// Of an inlier, as a part of the image's longer side, as long as the lens is a guess: what is wrong with it
// makes errors that grow with the image. Of 560 pixels that is 3.
constexpr double kGuessedError = 0.0054;
constexpr int kFewImages = 5;       // that tell no lens yet
constexpr int kRounds = 12;         // of lens and scene in turn, at most
constexpr int kFirstRounds = 4;     // the same, as long as images come in
constexpr double kSmallStep = 0.5;  // of a lens, in standard deviations as step_lens() has them
constexpr double kFewNew = 0.25;    // images after which all is adjusted, as a part of those posed
constexpr int kIterations = 10;     // of each adjustment

}  // namespace

RayGrowth::RayGrowth(const PointTracks& tracks, const Camera& guess, const RayOptions& options)
    : tracks_(tracks),
      options_(options),
      parameters_(Rig{{guess}}),
      of_image_(tracks.image_count),
      of_point_(tracks.point_count),
      values_(Eigen::VectorXd::Zero(parameters_.size())),
      max_error_(
          std::max(options.max_error_px, options.is_known ? 0.0 : kGuessedError * guess.longer_side())) {
  r_.camera = parameters_.given().cameras[0];
  r_.cam_from_world.resize(tracks.image_count);
  r_.points.assign(tracks.point_count, Eigen::Vector3d::Zero());
  r_.image_posed.assign(tracks.image_count, 0);
  r_.point_placed.assign(tracks.point_count, 0);
  r_.inlier.assign(tracks.size(), 0);
  dropped_.assign(tracks.image_count, 0);
  for (double* s : {&r_.sigma.focal, &r_.sigma.centre, &r_.sigma.rim})
    *s = std::numeric_limits<double>::infinity();
  for (int k = 0; k < tracks.size(); ++k) {
    of_image_[tracks.image[k]].push_back(k);
    of_point_[tracks.point[k]].push_back(k);
  }
  cast_rays();
  sigma_ = guess_sigma();
}

std::span<const Agreement> RayGrowth::agreements() const {
  return options_.in_order ? std::span<const Agreement>(kInVideo) : kInPhotos;
}

void RayGrowth::cast_rays() {
  has_ray_.resize(tracks_.size());
  ray_.resize(tracks_.size());
  for (int k = 0; k < tracks_.size(); ++k) {
    Ray ray;
    has_ray_[k] = r_.camera.ray(tracks_.pixel[k], &ray);
    ray_[k] = ray.direction;
  }
}

// The one that sees most placed points of those that were not tried, -1: none sees enough.
int RayGrowth::next_image() const {
  int best = -1, most = agreements()[agreement_].points - 1;
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (r_.image_posed[j] || tried_[j] || dropped_[j] >= kTimesDropped) continue;
    const auto seen =
        std::ranges::count_if(of_image_[j], [&](int k) { return r_.point_placed[tracks_.point[k]] != 0; });
    if (seen > most) most = static_cast<int>(seen), best = j;
  }
  return best;
}

bool RayGrowth::pose(int image) {
  tried_[image] = 1;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  for (const int k : of_image_[image]) {
    if (!r_.point_placed[tracks_.point[k]]) continue;
    points.push_back(r_.points[tracks_.point[k]]);
    pixels.push_back(tracks_.pixel[k]);
  }
  int nearest = -1;
  for (int j = 0; options_.in_order && j < tracks_.image_count; ++j) {
    if (r_.image_posed[j] && (nearest < 0 || std::abs(j - image) < std::abs(nearest - image))) nearest = j;
  }
  PoseOptions options;
  options.max_error_px = max_error_;
  const Agreement& enough = agreements()[agreement_];
  options.min_inliers =
      std::max(enough.points, static_cast<int>(enough.part * static_cast<double>(points.size())));
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(image);
  PoseEstimate found;
  estimator_.estimate(Rig{{r_.camera}}, {.points_in_world = points, .pixels = pixels},
                      nearest < 0 ? nullptr : &r_.cam_from_world[nearest], options, &found);
  if (!found.ok()) return false;
  r_.cam_from_world[image] = found.rig_from_world;
  r_.image_posed[image] = 1;
  ++r_.posed;
  return true;
}

// Where rays meet. Of photos, up to half of them may be wrong, those that miss it the most, as long as three
// are left.
bool RayGrowth::place(std::vector<Ray>* rays, Eigen::Vector3d* point) const {
  const double pixels_per_radian = r_.camera.pixels_per_radian();
  const size_t enough = options_.in_order ? rays->size() : std::max<size_t>(3, (rays->size() + 1) / 2);
  Triangulation t;
  for (;;) {
    if (rays->size() < 2 || !triangulate(*rays, &t)) return false;
    if (t.max_angle * pixels_per_radian <= max_error_) break;
    if (rays->size() <= enough) return false;
    const auto cosine = [&](const Ray& ray) {
      return ray.direction.dot((t.point - ray.origin).normalized());
    };
    rays->erase(std::ranges::min_element(*rays, {}, cosine));
  }
  if (t.parallax * pixels_per_radian < kLeastParallax * max_error_) return false;
  *point = t.point;
  return true;
}

// Of those that have no place.
void RayGrowth::place_points() {
  std::vector<Rigid3> world_from_cam(tracks_.image_count);
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (r_.image_posed[j]) world_from_cam[j] = r_.cam_from_world[j].inverse();
  }
  std::vector<Ray> rays;
  Ray ray;
  for (int p = 0; p < tracks_.point_count; ++p) {
    if (r_.point_placed[p]) continue;
    rays.clear();
    for (const int k : of_point_[p]) {
      const int image = tracks_.image[k];
      if (!r_.image_posed[image] || !r_.camera.ray(tracks_.pixel[k], &ray)) continue;
      rays.push_back({world_from_cam[image].translation, world_from_cam[image].rotation * ray.direction});
    }
    if (place(&rays, &r_.points[p])) r_.point_placed[p] = 1;
  }
}

RayProblemPart RayGrowth::part() const {
  RayProblemPart part;
  part.cameras = {r_.camera};
  std::vector<int> pose_of_image(tracks_.image_count, -1);
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (!r_.image_posed[j]) continue;
    pose_of_image[j] = static_cast<int>(part.poses.size());
    part.pose_is_free.push_back(!part.poses.empty());
    part.poses.push_back(r_.cam_from_world[j]);
    part.image.push_back(j);
  }
  for (int p = 0; p < tracks_.point_count; ++p) {
    if (!r_.point_placed[p]) continue;
    for (const int k : of_point_[p]) {
      const int pose = pose_of_image[tracks_.image[k]];
      if (pose < 0) continue;
      part.observations.push_back({pose, static_cast<int>(part.points.size()), 0, tracks_.pixel[k]});
      part.observation.push_back(k);
      part.inlier.push_back(r_.inlier[k]);
    }
    part.points.push_back(r_.points[p]);
    part.point.push_back(p);
  }
  return part;
}

void RayGrowth::adjust() {
  // Before an adjustment to another lens residuals are large all over: what agreed with the lens before takes
  // part whatever they are.
  constexpr double kWide = 5;
  RayProblemPart part = this->part();
  const BundleProblem problem = part.problem();
  update_inliers(problem, kWide * max_error_);
  for (size_t i = 0; i < part.inlier.size(); ++i) part.inlier[i] |= r_.inlier[part.observation[i]];
  const BundleOptions options{.loss = kRayLoss,
                              .max_iterations = kIterations,
                              .min_relative_decrease = 1e-4,
                              .threads = options_.threads};
  adjuster_.adjust_two_stage(problem, options, max_error_);
  std::vector<int> good(part.points.size(), 0), seen(part.points.size(), 0);
  for (size_t i = 0; i < part.observations.size(); ++i) {
    good[part.observations[i].point] += part.inlier[i];
    ++seen[part.observations[i].point];
  }
  for (size_t j = 0; j < part.poses.size(); ++j) r_.cam_from_world[part.image[j]] = part.poses[j];
  for (size_t i = 0; i < part.points.size(); ++i) {
    r_.points[part.point[i]] = part.points[i];
    r_.point_placed[part.point[i]] = good[i] >= 2 && 2 * good[i] > seen[i];
  }
  std::ranges::fill(r_.inlier, 0);
  for (size_t i = 0; i < part.observations.size(); ++i) {
    const int k = part.observation[i];
    r_.inlier[k] = part.inlier[i] && r_.point_placed[tracks_.point[k]];
  }
}

// Poses the images that can be, adjusting all as they come.
void RayGrowth::grow() {
  tried_.assign(tracks_.image_count, 0);
  agreement_ = 0;
  place_points();
  adjust();
  int fresh = 0;  // images
  while (r_.posed < tracks_.image_count && !stopped()) {
    const int image = next_image();
    if (image < 0 && fresh == 0) {
      if (++agreement_ == agreements().size()) return;
      tried_.assign(tracks_.image_count, 0);
      continue;
    }
    if (image >= 0) fresh += pose(image);
    if (image >= 0 && fresh < std::max(2.0, kFewNew * r_.posed)) continue;
    place_points();
    adjust();
    if (r_.posed >= kFewImages && !options_.is_known) {
      step_lens();
      adjust();
    }
    if (options_.progress) options_.progress(r_.posed);
    tried_.assign(tracks_.image_count, 0);
    agreement_ = 0;
    fresh = 0;
  }
}

// Of the observations of an image, of points that other posed images see as well.
double RayGrowth::agreeing_part(int image) const {
  int all = 0, agreeing = 0;
  for (const int k : of_image_[image]) {
    const auto& seen = of_point_[tracks_.point[k]];
    const auto posed =
        std::ranges::count_if(seen, [&](int o) { return r_.image_posed[tracks_.image[o]] != 0; });
    if (posed < 2) continue;
    ++all;
    agreeing += r_.inlier[k];
  }
  return all > 0 ? agreeing / double(all) : 0;
}

// Takes the poses of photos that few of their observations agree with, and the points that hang on them.
bool RayGrowth::drop_doubtful() {
  std::vector<int> doubtful;
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (r_.image_posed[j] && agreeing_part(j) < kDoubtful) doubtful.push_back(j);
  }
  for (const int j : doubtful) {
    r_.image_posed[j] = 0;
    --r_.posed;
    ++dropped_[j];
    for (const int k : of_image_[j]) r_.inlier[k] = 0;
  }
  for (int p = 0; p < tracks_.point_count; ++p) {
    const auto left = std::ranges::count_if(of_point_[p], [&](int k) { return r_.inlier[k] != 0; });
    if (left >= 2) continue;
    r_.point_placed[p] = 0;
    for (const int k : of_point_[p]) r_.inlier[k] = 0;
  }
  return !doubtful.empty();
}

// Everything that can be posed from a start.
void RayGrowth::complete() {
  do {
    // Images that the guess kept out may come in when the lens is known.
    for (int posed = 0; r_.posed > posed;) {
      posed = r_.posed;
      grow();
      settle(kFirstRounds);
    }
  } while (!options_.in_order && !stopped() && drop_doubtful());
  if (!options_.is_known) {
    max_error_ = options_.max_error_px;
    settle(kRounds);
  }
  if (r_.posed < 2) r_.posed = 0;
}

// Lens and scene in turn until the lens stays.
void RayGrowth::settle(int rounds) {
  for (int i = 0; i < rounds && !stopped(); ++i) {
    const double step = step_lens();
    place_points();
    adjust();
    if (step < kSmallStep) return;
  }
}

}  // namespace raysfm
