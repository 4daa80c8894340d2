#include "raysfm/robust/generic_start.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "raysfm/core/median.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/robust/rig_search.h"
#include "raysfm/robust/rotation_ransac.h"
#include "raysfm/robust/stereo_motion.h"

namespace raysfm {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kSameOrigin = 1e-9;  // units of length: origins so near are one
// Far below a squared standard deviation of a few hundred residuals.
constexpr RigRefiner::Options kHeldScale{.max_iterations = 40, .min_decrease = 5e-4, .hold_scale = true};

// The primary rays of a view, or their directions.
std::vector<Ray> primary_rays(const RigTable& table, int view) {
  std::vector<Ray> rays;
  rays.reserve(table.points.size());
  for (const RigTable::Point& point : table.points) rays.push_back(table.primary(point, view));
  return rays;
}
std::vector<Vector3d> primary_directions(const RigTable& table, int view) {
  std::vector<Vector3d> directions;
  directions.reserve(table.points.size());
  for (const RigTable::Point& point : table.points)
    directions.push_back(table.primary(point, view).direction);
  return directions;
}

bool all_from_one_origin(const RigTable& table) {
  return std::all_of(table.rays.begin(), table.rays.end(), [&](const ObservedRay& ray) {
    return (ray.origin - table.rays[0].origin).norm() <= kSameOrigin;
  });
}

// Radians that the largest error of an inlier amounts to, in the median.
double error_in_radians(const RigTable& table, double max_error) {
  std::vector<double> scales;
  for (const RigTable::Point& point : table.points) scales.push_back(std::sqrt(point.weight2));
  return max_error / std::max(median_of(&scales), 1e-300);
}

// Triangulates every point and decides on the inliers; fills points (in the table's frame), marks and
// figures.
void map_points(const RigTable& table, const RigMotion& motion, double max_error, GenericStart* start,
                std::vector<int>* inliers) {
  const std::array<Rigid3, 3> from_rig0 = {Rigid3{}, motion.rig1_from_rig0, motion.rig2_from_rig0};
  const std::array<Rigid3, 3> rig0_from = {Rigid3{}, from_rig0[1].inverse(), from_rig0[2].inverse()};
  std::vector<Ray> rays;
  std::vector<double> parallax;
  double squared = 0;
  int residuals = 0;
  inliers->clear();
  std::fill(start->inlier.begin(), start->inlier.end(), 0);
  for (int k = 0; k < table.size(); ++k) {
    const RigTable::Point& point = table.points[k];
    rays.clear();
    for (int i = point.begin; i < point.end; ++i) {
      const Rigid3& pose = rig0_from[table.views[i]];
      rays.push_back({pose * table.rays[i].origin, pose.rotation * table.rays[i].direction});
    }
    Triangulation result;
    bool inlier = triangulate(rays, &result);
    double own = 0;
    for (int i = point.begin; i < point.end && inlier; ++i) {
      Vector2d r(0, 0);
      inlier = table.rays[i].residual(from_rig0[table.views[i]] * result.point, &r) &&
               r.squaredNorm() <= max_error * max_error;
      own += r.squaredNorm();
    }
    if (!inlier) continue;
    inliers->push_back(k);
    start->inlier[point.index] = 1;
    start->points_in_rig0[point.index] = result.point;
    squared += own;
    residuals += point.end - point.begin;
    parallax.push_back(result.parallax);
  }
  start->inlier_count = static_cast<int>(inliers->size());
  start->median_parallax = start->least_parallax = median_of(&parallax);
  start->rms_error = std::sqrt(squared / std::max(1, residuals));
}

RigMotion scaled(const RigMotion& motion, double scale) {
  RigMotion result = motion;
  result.rig1_from_rig0.translation *= scale;
  result.rig2_from_rig0.translation *= scale;
  return result;
}

// The free minimum over the scale too and how much dearer half and double the scale are, in squared standard
// deviations of a residual. The valley along the scale is flat far from its bottom, so that it is walked in
// octaves.
struct ScaleProfile {
  double cost = 0, sigma2 = 0;
  double half = 0, twice = 0;
};

ScaleProfile descend_in_scale(const RigTable& table, std::span<const int> inliers, double least_sigma,
                              RigRefiner* refiner, RigMotion* motion) {
  constexpr int kMaxOctaves = 5;
  constexpr RigRefiner::Options kFree{.max_iterations = 40, .min_decrease = 1e-7};
  constexpr double kWorthAStep = 1;
  int freedom = -12;
  for (const int i : inliers) freedom += 2 * (table.points[i].end - table.points[i].begin) - 3;
  ScaleProfile profile;
  for (int octave = 0; octave < kMaxOctaves; ++octave) {
    profile.cost = refiner->refine(table, inliers, kFree, motion);
    profile.sigma2 = std::max(least_sigma * least_sigma, profile.cost / std::max(1, freedom));
    RigMotion half = scaled(*motion, 0.5), twice = scaled(*motion, 2);
    const auto rise = [&](RigMotion* held) {
      return (refiner->refine(table, inliers, kHeldScale, held) - profile.cost) / profile.sigma2;
    };
    profile.half = rise(&half), profile.twice = rise(&twice);
    if (!(std::min(profile.half, profile.twice) < -kWorthAStep)) break;
    *motion = profile.half < profile.twice ? half : twice;
  }
  return profile;
}

// Decides whether the scale of an adjusted motion is known, and where not makes the main centre move by 1 if
// that fits as well.
void judge_scale(const RigTable& table, std::span<const int> inliers, const GenericStartOptions& options,
                 RigMotion* motion, GenericStart* start) {
  constexpr double kAsWell = 3;         // standard deviations
  constexpr double kLeastSigma = 1e-3;  // of the error of an inlier: exact rays still have rounding
  constexpr double kLeastMotion = 1e-12;
  if (!(motion->rig2_from_rig0.translation.norm() > kLeastMotion)) return;
  RigRefiner refiner;
  RigMotion unit = scaled(*motion, 1 / motion->rig2_from_rig0.translation.norm());
  const ScaleProfile profile =
      descend_in_scale(table, inliers, kLeastSigma * options.max_error, &refiner, motion);
  start->scale_significance = std::sqrt(std::max(0.0, std::min(profile.half, profile.twice)));
  start->scale_known = start->scale_significance >= options.min_scale_significance;
  if (start->scale_known) return;
  const double rise = refiner.refine(table, inliers, kHeldScale, &unit) - profile.cost;
  if (rise < kAsWell * kAsWell * profile.sigma2) *motion = unit;
}

// Refinements of the search's best motion, on its inliers and on those of the refined. The first are chosen
// generously: at a scale that is off, the other cameras' points lie just outside.
void polish(const RigTable& table, const GenericStartOptions& options, std::vector<int> inliers,
            RigMotion motion, GenericStart* start) {
  constexpr std::array<double, 3> kErrors = {2, 1.5, 1};
  constexpr RigRefiner::Options kRound{.max_iterations = 15, .min_decrease = 1e-4};
  RigRefiner refiner;
  for (const double factor : kErrors) {
    refiner.refine(table, inliers, kRound, &motion);
    map_points(table, motion, factor * options.max_error, start, &inliers);
  }
  judge_scale(table, inliers, options, &motion, start);
  map_points(table, motion, options.max_error, start, &inliers);
  // Back to the rig's own origin: x' = x - centre in every view.
  const Vector3d& c = table.centre;
  const auto about_origin = [&](const Rigid3& pose) {
    return Rigid3{pose.rotation, pose.translation + c - pose.rotation * c};
  };
  start->rig1_from_rig0 = about_origin(motion.rig1_from_rig0);
  start->rig2_from_rig0 = about_origin(motion.rig2_from_rig0);
  for (Vector3d& point : start->points_in_rig0) point += c;
}

double enough_inliers(int points, const GenericStartOptions& options) {
  return std::max<double>(options.min_inliers, options.min_inlier_ratio * points);
}

StartProblem diagnose(const GenericStart& start, int matches, const GenericStartOptions& options) {
  const double enough = enough_inliers(matches, options);
  const bool rotation = start.rotation_inliers >= enough &&
                        start.rotation_inliers >= options.rotation_advantage * start.inlier_count;
  if (rotation) return StartProblem::kRotationOnly;
  if (start.inlier_count < enough) return StartProblem::kTooFewInliers;
  if (start.least_parallax < options.min_parallax) return StartProblem::kTooLittleParallax;
  return StartProblem::kNone;
}

template <typename Search>
void search(Search problem, const RigTable& table, const GenericStartOptions& options, GenericStart* start) {
  RigMotion motion;
  const RansacReport report = ransac(problem,
                                     {.max_iterations = options.max_iterations,
                                      .confidence = options.confidence,
                                      .seed = options.seed,
                                      .stream = options.stream},
                                     &motion);
  start->iterations = report.iterations;
  if (!report.found()) return;
  std::vector<int> inliers;
  problem.collect_inliers(motion, &inliers);
  polish(table, options, std::move(inliers), motion, start);
}

void start_central(const RigTable& table, const GenericStartOptions& options, GenericStart* start) {
  start->method = GenericStartMethod::kCentral;
  const ThreeViewOptions central{.max_error = error_in_radians(table, options.max_error),
                                 .min_matches = options.min_matches,
                                 .min_inliers = options.min_inliers,
                                 .min_inlier_ratio = options.min_inlier_ratio,
                                 .min_displacement = options.min_displacement,
                                 .min_parallax = options.min_parallax,
                                 .rotation_advantage = options.rotation_advantage,
                                 .min_rival_cost = options.min_rival_cost,
                                 .max_iterations = options.max_iterations,
                                 .confidence = options.confidence,
                                 .seed = options.seed,
                                 .stream = options.stream};
  const ThreeViewStart found = start_from_three_views(
      primary_directions(table, 0), primary_directions(table, 1), primary_directions(table, 2), central);
  start->problem = found.problem;
  const Vector3d& c = table.centre;
  const auto about_origin = [&](const Rigid3& pose) {
    return Rigid3{pose.rotation, pose.translation + c - pose.rotation * c};
  };
  start->rig1_from_rig0 = about_origin(found.cam1_from_cam0);
  start->rig2_from_rig0 = about_origin(found.cam2_from_cam0);
  for (int i = 0; i < table.size(); ++i) {
    start->inlier[table.points[i].index] = found.inlier[i];
    start->points_in_rig0[table.points[i].index] = found.points_in_cam0[i] + c;
  }
  start->inlier_count = found.inlier_count;
  start->median_displacement = found.median_displacement;
  start->median_parallax = found.median_parallax;
  start->least_parallax = found.least_parallax;
  start->rms_error = found.rms_error * options.max_error / central.max_error;
  start->rotation_inliers = found.rotation_inliers;
  start->rival_cost = found.rival_cost;
  start->iterations = found.iterations;
}

// Points known at the instant of view 0 need no motion to be a start. False where they do not do.
bool start_from_stereo(const RigTable& table, const GenericStartOptions& options, GenericStart* start) {
  start->method = GenericStartMethod::kStereoPoints;
  RigMotion motion;
  std::vector<int> inliers;
  if (!motion_from_stereo_points(table, options, &motion, &inliers)) return false;
  polish(table, options, std::move(inliers), motion, start);
  start->problem = diagnose(*start, table.size(), options);
  return start->ok();
}

void start_from_motion(const RigTable& table, const GenericStartOptions& options, GenericStart* start) {
  start->problem = StartProblem::kNoMotion;
  if (!(start->median_displacement >= options.min_displacement)) return;
  const std::vector<Vector3d> directions0 = primary_directions(table, 0),
                              directions2 = primary_directions(table, 2);
  start->rotation_inliers =
      rotation_inliers(directions0, directions2, error_in_radians(table, options.max_error),
                       enough_inliers(table.size(), options),
                       {.max_iterations = options.max_iterations,
                        .confidence = options.confidence,
                        .seed = options.seed,
                        .stream = options.stream});
  if (start->method == GenericStartMethod::kSeventeenPoint) {
    search(SeventeenPointRansac(table, options.max_error, start->ray_class), table, options, start);
  } else {
    start->method = GenericStartMethod::kFivePoints;
    search(FivePointRansac(table, options.max_error), table, options, start);
  }
  start->problem = diagnose(*start, table.size(), options);
}

}  // namespace

GenericStart start_generic(const RigMatches& matches, const GenericStartOptions& options) {
  GenericStart start;
  start.method = options.method;
  start.points_in_rig0.assign(std::max(0, matches.point_count), Vector3d::Zero());
  start.inlier.assign(start.points_in_rig0.size(), 0);
  const RigTable table = make_rig_table(matches);
  if (table.size() < std::max(6, options.min_matches)) return start;

  start.ray_class = classify_rays(primary_rays(table, 0), primary_rays(table, 2), 1e-6, kSameOrigin);
  std::vector<double> displacement;
  for (const RigTable::Point& point : table.points) {
    displacement.push_back(
        angle_between(table.primary(point, 0).direction, table.primary(point, 2).direction));
  }
  start.median_displacement = median_of(&displacement);

  using Method = GenericStartMethod;
  const bool automatic = options.method == Method::kAuto;
  if (options.method == Method::kCentral || (automatic && all_from_one_origin(table))) {
    start_central(table, options, &start);
    start.ray_class.centre += table.centre;
    return start;
  }
  const GenericStart empty = start;
  const bool stereo =
      (automatic || options.method == Method::kStereoPoints) && start_from_stereo(table, options, &start);
  if (!stereo && options.method != Method::kStereoPoints) {
    start = empty;
    start_from_motion(table, options, &start);
  }
  start.ray_class.centre += table.centre;
  return start;
}

std::string describe(const GenericStart& start) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  if (start.method == GenericStartMethod::kCentral || !start.ok()) {
    // The central start's words; it has the same figures.
    ThreeViewStart central;
    central.problem = start.problem;
    central.inlier = start.inlier;
    central.inlier_count = start.inlier_count;
    central.median_displacement = start.median_displacement;
    central.median_parallax = start.median_parallax;
    central.least_parallax = start.least_parallax;
    central.rotation_inliers = start.rotation_inliers;
    central.rival_cost = start.rival_cost;
    return describe(central);
  }
  char text[240];
  std::snprintf(
      text, sizeof text,
      "%d of %zu matches agree, median parallax %.2f degrees, %s rays, scale %s (significance %.1f)",
      start.inlier_count, start.inlier.size(), kDegrees * start.median_parallax,
      name_of(start.ray_class.centres), start.scale_known ? "known" : "not observable",
      start.scale_significance);
  return text;
}

}  // namespace raysfm
