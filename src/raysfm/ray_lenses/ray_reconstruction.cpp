#include "raysfm/ray_lenses/ray_reconstruction.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/calibration/calibration_evidence.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/robust/three_view_start.h"

namespace raysfm {
namespace {

using Kind = RigParameters::Kind;

// Of the first image of a start, the points that the last one sees as well: at least so many, and this part.
constexpr int kLeastShared = 50;
constexpr double kSharedByStart = 0.4;
constexpr int kLeastSeen = 20;          // points by which an image is posed
constexpr double kLeastAgreeing = 0.5;  // part of them
constexpr double kLeastParallax = 6;    // of a point, pixels
constexpr int kFewImages = 5;           // that tell no lens yet
constexpr int kRounds = 12;             // of lens and scene in turn, at most
constexpr double kSmallStep = 0.005;    // of a lens, in standard deviations of the guess
constexpr double kFewNew = 0.25;        // images after which all is adjusted, as a part of those posed
constexpr int kIterations = 10;         // of each adjustment
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

  bool start();
  void grow();
  void settle();
  void take_sigma();
  RayReconstruction& result() { return r_; }

 private:
  Eigen::VectorXd guess_sigma() const;
  double effect_on_rim(int parameter, const Eigen::Vector3d& rim) const;
  Eigen::Vector3d direction_of_rim() const;
  void cast_rays();
  bool start_at(int first);
  int last_of_start(int first) const;
  int next_image() const;
  bool pose(int image);
  void place_points();
  ProblemPart part() const;
  void adjust();
  double step_lens();
  bool try_lens(const Eigen::VectorXd& values);
  bool stopped() const { return options_.stopped && options_.stopped(); }

  const PointTracks& tracks_;
  const RayOptions& options_;
  const RigParameters parameters_;
  RayReconstruction r_;
  std::vector<std::vector<int>> of_image_, of_point_;  // observations
  Eigen::VectorXd values_, sigma_;                     // of the parameters: present, and of the guess
  std::vector<uint8_t> has_ray_, tried_;
  std::vector<Eigen::Vector3d> ray_;  // one per observation
  BundleAdjuster adjuster_;
  PoseEstimator estimator_;
};

RayGrowth::RayGrowth(const PointTracks& tracks, const Camera& guess, const RayOptions& options)
    : tracks_(tracks),
      options_(options),
      parameters_(Rig{{guess}}),
      of_image_(tracks.image_count),
      of_point_(tracks.point_count),
      values_(Eigen::VectorXd::Zero(parameters_.size())) {
  r_.camera = parameters_.given().cameras[0];
  r_.cam_from_world.resize(tracks.image_count);
  r_.points.assign(tracks.point_count, Eigen::Vector3d::Zero());
  r_.image_posed.assign(tracks.image_count, 0);
  r_.point_placed.assign(tracks.point_count, 0);
  r_.inlier.assign(tracks.size(), 0);
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

bool RayGrowth::start_at(int first) {
  const int last = last_of_start(first);
  if (last < 0) return false;
  const int images[3] = {first, (first + last) / 2, last};
  std::vector<int> seen[2];
  for (int v = 0; v < 2; ++v) {
    seen[v].assign(tracks_.point_count, -1);
    for (const int k : of_image_[images[v]]) {
      if (has_ray_[k]) seen[v][tracks_.point[k]] = k;
    }
  }
  std::vector<Eigen::Vector3d> bearings[3];
  std::vector<int> points;
  for (const int k : of_image_[last]) {
    const int point = tracks_.point[k];
    if (!has_ray_[k] || seen[0][point] < 0 || seen[1][point] < 0) continue;
    points.push_back(point);
    bearings[0].push_back(ray_[seen[0][point]]);
    bearings[1].push_back(ray_[seen[1][point]]);
    bearings[2].push_back(ray_[k]);
  }
  ThreeViewOptions options;
  options.max_error = options_.max_error_px / r_.camera.pixels_per_radian();
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(first);
  const ThreeViewStart s = start_from_three_views(bearings[0], bearings[1], bearings[2], options);
  if (!s.ok()) return false;
  const Rigid3 cam_from_first[3] = {Rigid3{}, s.cam1_from_cam0, s.cam2_from_cam0};
  for (int v = 0; v < 3; ++v) {
    r_.cam_from_world[images[v]] = cam_from_first[v];
    r_.image_posed[images[v]] = 1;
  }
  for (size_t i = 0; i < points.size(); ++i) {
    r_.points[points[i]] = s.points_in_cam0[i];
    r_.point_placed[points[i]] = s.inlier[i];
  }
  r_.posed = 3;
  adjust();
  return true;
}

bool RayGrowth::start() {
  constexpr int kEighths[] = {0, 2, 4, 6, 1, 3, 5};
  for (const int e : kEighths) {
    if (start_at(e * tracks_.image_count / 8)) return true;
  }
  return false;
}

// The one that sees most placed points of those that were not tried, -1: none sees enough.
int RayGrowth::next_image() const {
  int best = -1, most = kLeastSeen - 1;
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (r_.image_posed[j] || tried_[j]) continue;
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
  for (int j = 0; j < tracks_.image_count; ++j) {
    if (r_.image_posed[j] && (nearest < 0 || std::abs(j - image) < std::abs(nearest - image))) nearest = j;
  }
  PoseOptions options;
  options.max_error_px = options_.max_error_px;
  options.min_inliers =
      std::max(kLeastSeen, static_cast<int>(kLeastAgreeing * static_cast<double>(points.size())));
  options.seed = options_.seed;
  options.stream = static_cast<uint64_t>(image);
  PoseEstimate found;
  estimator_.estimate(Rig{{r_.camera}}, {.points_in_world = points, .pixels = pixels},
                      &r_.cam_from_world[nearest], options, &found);
  if (!found.ok()) return false;
  r_.cam_from_world[image] = found.rig_from_world;
  r_.image_posed[image] = 1;
  ++r_.posed;
  return true;
}

// Of those that have no place.
void RayGrowth::place_points() {
  cast_rays();
  const double pixels_per_radian = r_.camera.pixels_per_radian();
  std::vector<Ray> rays;
  for (int p = 0; p < tracks_.point_count; ++p) {
    if (r_.point_placed[p]) continue;
    rays.clear();
    for (const int k : of_point_[p]) {
      if (!r_.image_posed[tracks_.image[k]] || !has_ray_[k]) continue;
      const Rigid3 world_from_cam = r_.cam_from_world[tracks_.image[k]].inverse();
      rays.push_back({world_from_cam.translation, world_from_cam.rotation * ray_[k]});
    }
    Triangulation t;
    if (rays.size() < 2 || !triangulate(rays, &t)) continue;
    if (t.max_angle * pixels_per_radian > options_.max_error_px ||
        t.parallax * pixels_per_radian < kLeastParallax)
      continue;
    r_.points[p] = t.point;
    r_.point_placed[p] = 1;
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
  // Before an adjustment to another lens residuals are large all over.
  constexpr double kWide = 5;
  ProblemPart part = this->part();
  const BundleProblem problem = part.problem();
  update_inliers(problem, kWide * options_.max_error_px);
  const BundleOptions options{.loss = kRayLoss,
                              .max_iterations = kIterations,
                              .min_relative_decrease = 1e-4,
                              .threads = options_.threads};
  adjuster_.adjust_two_stage(problem, options, options_.max_error_px);
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

// To the lens that guess and residuals make likeliest. Returns how far that is, in standard deviations of the
// guess.
double RayGrowth::step_lens() {
  constexpr int kHalvings = 5;
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
    if (try_lens(values_ + unit * step)) return step.norm();
  }
  return 0;
}

// Poses the images that can be, adjusting all as they come.
void RayGrowth::grow() {
  tried_.assign(tracks_.image_count, 0);
  place_points();
  adjust();
  int fresh = 0;  // images
  while (r_.posed < tracks_.image_count && !stopped()) {
    const int image = next_image();
    if (image < 0 && fresh == 0) return;
    if (image >= 0) fresh += pose(image);
    if (image >= 0 && fresh < std::max(2.0, kFewNew * r_.posed)) continue;
    place_points();
    adjust();
    if (r_.posed >= kFewImages) {
      step_lens();
      adjust();
    }
    tried_.assign(tracks_.image_count, 0);
    fresh = 0;
  }
}

// Lens and scene in turn until the lens stays.
void RayGrowth::settle() {
  for (int i = 0; i < kRounds && !stopped(); ++i) {
    const double step = step_lens();
    place_points();
    adjust();
    if (step < kSmallStep) return;
  }
}

void RayGrowth::take_sigma() {
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

RayReconstruction reconstruct_along_rays(const PointTracks& tracks, const Camera& guess,
                                         const RayOptions& options) {
  RayGrowth growth(tracks, guess, options);
  if (!growth.start()) return std::move(growth.result());
  // Images that the guess kept out may come in when the lens is known.
  for (int posed = 0; growth.result().posed > posed;) {
    posed = growth.result().posed;
    growth.grow();
    growth.settle();
  }
  growth.take_sigma();
  return std::move(growth.result());
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
