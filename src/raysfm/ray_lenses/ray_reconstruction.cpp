#include "raysfm/ray_lenses/ray_reconstruction.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/calibration/calibration_evidence.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/ray_lenses/threes_in_sight.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/robust/three_view_start.h"

namespace raysfm {
namespace {

using Kind = RigParameters::Kind;

// Of the first image of a start, the points that the last one sees as well: at least so many, and this part.
constexpr int kLeastShared = 50;
constexpr double kSharedByStart = 0.4;
// What poses an image: points that agree, and which part of all that it sees.
struct Agreement {
  int points;
  double part;
};
constexpr Agreement kInVideo[] = {{20, 0.5}};
// Matches of photos reach far and are wrong more often: what is posed by fewer comes last.
constexpr Agreement kInPhotos[] = {{20, 0.5}, {15, 0.3}};
// Part of the observations of a photo, of points that others see as well, below which its pose is no good:
// they are 0.5 to 1 of right poses and 0.08 to 0.45 of wrong ones.
constexpr double kDoubtful = 0.45;
constexpr int kTimesDropped = 2;  // after which a photo stays out
constexpr int kStarts = 4;        // of photos, while they lead to no more than most of them
constexpr double kMost = 0.8;
constexpr double kLeastParallax = 2;  // of a point, in errors of an inlier at most
// Of an inlier, as a part of the image's width, as long as the lens is a guess: what is wrong with it makes
// errors that grow with the image. Of 560 pixels that is 3.
constexpr double kGuessedError = 0.0054;
constexpr int kFewImages = 5;       // that tell no lens yet
constexpr int kRounds = 12;         // of lens and scene in turn, at most
constexpr int kFirstRounds = 4;     // the same, as long as images come in
constexpr double kSmallStep = 0.5;  // of a lens, in standard deviations as step_lens() has them
constexpr double kFewNew = 0.25;    // images after which all is adjusted, as a part of those posed
constexpr int kIterations = 10;     // of each adjustment
const RobustLoss kRayLoss{RobustLoss::Kind::kHuber, 0.5};
// How far off the guess may be: a coefficient of the model by what moves the rim of the image by this part;
// pixels are taken to be square.
constexpr double kGuessedFocal = 0.3, kSquare = 1e-5, kGuessedRim = 0.1;

// One number per image or observation of a problem to that of the tracks.
struct ProblemPart {
  std::vector<Camera> cameras;
  std::vector<int> image, point, observation;  // of the tracks, by number in the problem
  std::vector<Rigid3> poses;
  std::vector<uint8_t> pose_is_free, inlier;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleObservation> observations;

  BundleProblem problem() {
    return {.cameras = cameras,
            .rig_from_world = poses,
            .pose_is_free = pose_is_free,
            .points = points,
            .point_is_fixed = {},
            .observations = observations,
            .is_inlier = inlier,
            .rays = {},
            .lenses = {},
            .sigmas = {},
            .scale_prior = {}};
  }
};

class RayGrowth {
 public:
  RayGrowth(const PointTracks& tracks, const Camera& guess, const RayOptions& options);

  // `avoided`: images two of which make no start, one mark each.
  bool start(std::span<const uint8_t> avoided);
  void go_on_from(const RayReconstruction& start);
  void complete();
  void take_sigma();
  RayReconstruction& result() { return r_; }

 private:
  void grow();
  void settle(int rounds);
  bool drop_doubtful();
  double agreeing_part(int image) const;
  std::span<const Agreement> agreements() const {
    return options_.in_order ? std::span<const Agreement>(kInVideo) : kInPhotos;
  }
  Eigen::VectorXd guess_sigma() const;
  double effect_on_rim(int parameter, const Eigen::Vector3d& rim) const;
  Eigen::Vector3d direction_of_rim() const;
  void cast_rays();
  bool start_along_video();
  bool start_anywhere(std::span<const uint8_t> avoided);
  int last_of_start(int first) const;
  ThreeViewStart three_view_start(const std::array<int, 3>& images, std::vector<int>* points) const;
  void take(const std::array<int, 3>& images, const ThreeViewStart& start, std::span<const int> points);
  int next_image() const;
  bool pose(int image);
  void place_points();
  ProblemPart part() const;
  void adjust();
  double step_lens();
  bool try_lens(const Eigen::VectorXd& values);
  bool place(std::vector<Ray>* rays, Eigen::Vector3d* point) const;
  bool stopped() const { return options_.stopped && options_.stopped(); }

  const PointTracks& tracks_;
  const RayOptions& options_;
  const RigParameters parameters_;
  RayReconstruction r_;
  std::vector<std::vector<int>> of_image_, of_point_;  // observations
  Eigen::VectorXd values_, sigma_;                     // of the parameters: present, and of the guess
  double max_error_;                                   // of an inlier, pixels
  std::vector<uint8_t> has_ray_;                       // one per observation, through the guess
  std::vector<uint8_t> tried_;                         // one per image
  size_t agreement_ = 0;              // the one of agreements() that images are posed by at present
  std::vector<int> dropped_;          // how often each image was
  std::vector<Eigen::Vector3d> ray_;  // one per observation, through the guess
  BundleAdjuster adjuster_;
  PoseEstimator estimator_;
};

RayGrowth::RayGrowth(const PointTracks& tracks, const Camera& guess, const RayOptions& options)
    : tracks_(tracks),
      options_(options),
      parameters_(Rig{{guess}}),
      of_image_(tracks.image_count),
      of_point_(tracks.point_count),
      values_(Eigen::VectorXd::Zero(parameters_.size())),
      max_error_(std::max(options.max_error_px, options.is_known ? 0.0 : kGuessedError * guess.width)) {
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

Eigen::Vector3d RayGrowth::direction_of_rim() const {
  int farthest = -1;
  for (int k = 0; k < tracks_.size(); ++k) {
    if (has_ray_[k] && (farthest < 0 || ray_[k].z() < ray_[farthest].z())) farthest = k;
  }
  return farthest < 0 ? Eigen::Vector3d::UnitX() : ray_[farthest];
}

// Part of its distance from the centre by which a unit of a parameter moves the pixel of a ray.
double RayGrowth::effect_on_rim(int parameter, const Eigen::Vector3d& rim) const {
  Eigen::VectorXd moved = values_;
  moved[parameter] += parameters_[parameter].step;
  Eigen::Vector2d centre, before, after;
  const Camera& camera = parameters_.given().cameras[0];
  if (!camera.project(Eigen::Vector3d::UnitZ(), &centre) || !camera.project(rim, &before) ||
      !parameters_.rig(moved).cameras[0].project(rim, &after))
    return 1;
  return (after - before).norm() / (before - centre).norm() / parameters_[parameter].step;
}

Eigen::VectorXd RayGrowth::guess_sigma() const {
  const CalibrationPrior guess{.focal = kGuessedFocal, .aspect = kSquare, .centre = options_.centre_sigma};
  const RigParameters wide(parameters_.given(), 1, guess);
  const Eigen::Vector3d rim = direction_of_rim();
  Eigen::VectorXd sigma(parameters_.size());
  for (int i = 0; i < parameters_.size(); ++i) {
    const bool is_coefficient = parameters_[i].kind == Kind::kNumber && parameters_.name(i)[0] != 'c';
    sigma[i] = is_coefficient ? kGuessedRim / effect_on_rim(i, rim) : wide[i].prior_sigma;
  }
  return sigma;
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

// The last image that still shares much with the first, each in between doing so too; -1: there is none.
int RayGrowth::last_of_start(int first) const {
  std::vector<uint8_t> seen(tracks_.point_count, 0);
  for (const int k : of_image_[first]) seen[tracks_.point[k]] = 1;
  const double enough =
      std::max<double>(kLeastShared, kSharedByStart * static_cast<double>(of_image_[first].size()));
  int last = first + 2;
  while (last + 1 < tracks_.image_count) {
    const auto shared =
        std::ranges::count_if(of_image_[last + 1], [&](int k) { return seen[tracks_.point[k]]; });
    if (static_cast<double>(shared) < enough) break;
    ++last;
  }
  return last < tracks_.image_count ? last : -1;
}

// Of three images, the first and the last of which are the farthest apart; `points`: what they see in common.
ThreeViewStart RayGrowth::three_view_start(const std::array<int, 3>& images, std::vector<int>* points) const {
  std::vector<int> seen[2];
  for (int v = 0; v < 2; ++v) {
    seen[v].assign(tracks_.point_count, -1);
    for (const int k : of_image_[images[v]]) {
      if (has_ray_[k]) seen[v][tracks_.point[k]] = k;
    }
  }
  std::vector<Eigen::Vector3d> bearings[3];
  points->clear();
  for (const int k : of_image_[images[2]]) {
    const int point = tracks_.point[k];
    if (!has_ray_[k] || seen[0][point] < 0 || seen[1][point] < 0) continue;
    points->push_back(point);
    bearings[0].push_back(ray_[seen[0][point]]);
    bearings[1].push_back(ray_[seen[1][point]]);
    bearings[2].push_back(ray_[k]);
  }
  ThreeViewOptions options;
  options.max_error = max_error_ / r_.camera.pixels_per_radian();
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(images[0]);
  options.searches = 1;  // to a lens that is guessed a better fit means little, and photos have many threes
  return start_from_three_views(bearings[0], bearings[1], bearings[2], options);
}

void RayGrowth::take(const std::array<int, 3>& images, const ThreeViewStart& start,
                     std::span<const int> points) {
  const Rigid3 cam_from_first[3] = {Rigid3{}, start.cam1_from_cam0, start.cam2_from_cam0};
  for (int v = 0; v < 3; ++v) {
    r_.cam_from_world[images[v]] = cam_from_first[v];
    r_.image_posed[images[v]] = 1;
  }
  for (size_t i = 0; i < points.size(); ++i) {
    r_.points[points[i]] = start.points_in_cam0[i];
    r_.point_placed[points[i]] = start.inlier[i];
  }
  r_.posed = 3;
  r_.start_images = images;
  r_.start_inliers = start.inlier_count;
  adjust();
}

bool RayGrowth::start_along_video() {
  constexpr int kEighths[] = {0, 2, 4, 6, 1, 3, 5};
  std::vector<int> points;
  for (const int e : kEighths) {
    const int first = e * tracks_.image_count / 8, last = last_of_start(first);
    if (last < 0) continue;
    const std::array<int, 3> images = {first, (first + last) / 2, last};
    const ThreeViewStart start = three_view_start(images, &points);
    if (!start.ok()) continue;
    take(images, start, points);
    return true;
  }
  return false;
}

// Of many threes of images that see much in common, the one that tells most points well.
bool RayGrowth::start_anywhere(std::span<const uint8_t> avoided) {
  constexpr double kGoodParallax = 0.15;  // radians; more makes a start no better
  double best = 0;
  std::array<int, 3> best_images = {};
  ThreeViewStart best_start;
  std::vector<int> points, best_points;
  for (const std::array<int, 3>& images : threes_in_sight(tracks_, of_image_)) {
    if (stopped()) break;
    if (std::ranges::count_if(images, [&](int j) { return avoided[j] != 0; }) > 1) continue;
    ThreeViewStart start = three_view_start(images, &points);
    const double worth = start.inlier_count * std::min(1.0, start.median_parallax / kGoodParallax);
    if (!start.ok() || worth <= best) continue;
    best = worth;
    best_images = images;
    best_start = std::move(start);
    best_points = points;
  }
  if (best > 0) take(best_images, best_start, best_points);
  return best > 0;
}

bool RayGrowth::start(std::span<const uint8_t> avoided) {
  return options_.in_order ? start_along_video() : start_anywhere(avoided);
}

void RayGrowth::go_on_from(const RayReconstruction& start) {
  r_ = start;
  r_.inlier.assign(tracks_.size(), 0);
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

ProblemPart RayGrowth::part() const {
  ProblemPart part;
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
  ProblemPart part = this->part();
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

// Takes another lens over, where it is one, and what agrees with the present one is seen by it.
bool RayGrowth::try_lens(const Eigen::VectorXd& values) {
  const Camera camera = parameters_.rig(values).cameras[0];
  if (find_problem(camera.model)) return false;
  for (int k = 0; k < tracks_.size(); ++k) {
    Ray ray;
    if (r_.inlier[k] && !camera.ray(tracks_.pixel[k], &ray)) return false;
  }
  values_ = values;
  r_.camera = camera;
  return true;
}

// To the lens that guess and residuals make likeliest. Returns how far that is, in standard deviations of
// what both tell, as if no error were like another.
double RayGrowth::step_lens() {
  constexpr int kHalvings = 5;
  if (options_.is_known) return 0;
  ProblemPart part = this->part();
  const auto evidence = measure_calibration(part.problem(), {.loss = kRayLoss}, parameters_, values_);
  if (!evidence) return 0;
  const double variance = evidence->cost / std::max(1, evidence->observations);
  const Eigen::VectorXd guess = variance * sigma_.cwiseAbs2().cwiseInverse();
  Eigen::MatrixXd information = evidence->information;
  information.diagonal() += guess;
  const auto unit = sigma_.asDiagonal();
  const Eigen::MatrixXd scaled = unit * information * unit;
  const Eigen::VectorXd right = -(unit * (evidence->gradient + guess.cwiseProduct(values_)));
  Eigen::VectorXd step = scaled.ldlt().solve(right);
  for (int h = 0; h < kHalvings; ++h, step *= 0.5) {
    if (try_lens(values_ + unit * step)) return std::sqrt(step.dot(scaled * step) / variance);
  }
  return 0;
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

void RayGrowth::take_sigma() {
  if (options_.is_known) return;
  ProblemPart part = this->part();
  const auto evidence = measure_calibration(part.problem(), {.loss = kRayLoss}, parameters_, values_);
  if (!evidence) return;
  const CalibrationEvidence& e = *evidence;
  const auto unit = sigma_.asDiagonal();
  const double variance = e.cost / std::max(1, e.observations);
  const Eigen::MatrixXd information = unit * e.information * unit;
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(information.rows(), information.cols());
  const Eigen::MatrixXd inverse = (information + variance * identity).inverse();
  const Eigen::MatrixXd scatter = unit * e.scatter * unit + variance * information;
  const Eigen::VectorXd sigma = unit * (inverse * scatter * inverse).diagonal().cwiseSqrt();
  CalibrationPrior& s = r_.sigma;
  s.focal = s.centre = s.rim = 0;
  const CalibrationPrior usual;
  for (int i = 0; i < parameters_.size(); ++i) {
    const bool is_centre = parameters_[i].kind == Kind::kNumber && parameters_.name(i)[0] == 'c';
    if (parameters_[i].kind == Kind::kFocal) {
      s.focal = sigma[i];
    } else if (is_centre) {
      s.centre = std::max(s.centre, sigma[i] / r_.camera.width);
    } else if (parameters_[i].kind == Kind::kNumber) {
      r_.strain = std::max(r_.strain, std::abs(values_[i]) / sigma_[i]);
      s.rim = std::max(s.rim, usual.rim * sigma[i] / parameters_[i].prior_sigma);
    }
  }
}

}  // namespace

double agreeing_share(const PointTracks& tracks, const RayReconstruction& r) {
  std::vector<int> seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) seen[tracks.point[k]] += r.image_posed[tracks.image[k]];
  int all = 0, agreeing = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!r.image_posed[tracks.image[k]] || seen[tracks.point[k]] < 2) continue;
    ++all;
    agreeing += r.inlier[k];
  }
  return all > 0 ? agreeing / double(all) : 0;
}

RayReconstruction reconstruct_along_rays(const PointTracks& tracks, const Camera& guess,
                                         const RayOptions& options) {
  if (options.start) {
    RayGrowth growth(tracks, guess, options);
    growth.go_on_from(*options.start);
    growth.complete();
    return std::move(growth.result());
  }
  RayReconstruction best;
  std::vector<uint8_t> tried(tracks.image_count, 0);  // as starts, or posed by one
  std::vector<uint8_t> sees(tracks.image_count, 0);
  for (const int image : tracks.image) sees[image] = 1;
  const double most = kMost * static_cast<double>(std::ranges::count(sees, 1));
  for (int i = 0; i < (options.in_order ? 1 : kStarts); ++i) {
    RayGrowth growth(tracks, guess, options);
    const bool started = growth.start(tried);
    if (started) {
      growth.complete();
      growth.take_sigma();
    }
    RayReconstruction& found = growth.result();
    for (int j = 0; j < tracks.image_count; ++j) tried[j] |= found.image_posed[j];
    for (const int j : found.start_images) {
      if (j >= 0) tried[j] = 1;
    }
    if (i == 0 || found.posed > best.posed) best = std::move(found);
    if (!started || best.posed >= most) break;
  }
  return best;
}

bool pixel_residual(const PointTracks& tracks, const RayReconstruction& r, int k, Eigen::Vector2d* residual) {
  const int image = tracks.image[k], point = tracks.point[k];
  Eigen::Vector2d pixel;
  if (!r.image_posed[image] || !r.point_placed[point] ||
      !r.camera.project(r.cam_from_world[image] * r.points[point], &pixel))
    return false;
  *residual = pixel - tracks.pixel[k];
  return true;
}

}  // namespace raysfm
