#include "raysfm/robust/three_view_start.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "raysfm/core/median.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/robust/ransac.h"
#include "raysfm/robust/rotation_ransac.h"
#include "raysfm/robust/three_view_refinement.h"
#include "raysfm/robust/three_view_sample.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr uint64_t kOtherSeed = 0x9e3779b97f4a7c15;

// Motion over three views from five matches.
class MotionRansac {
 public:
  using Model = ThreeViewMotion;
  static constexpr int kSampleSize = 5;
  static constexpr int kMaxModels = 10;

  MotionRansac(const ThreeViewBearings& bearings, double max_error) : bearings_(bearings) {
    // Half the sum of two squared errors, each holding the noise of view 0 as well as its own.
    scale_ = 0.25 / (max_error * max_error);
    inliers_.reserve(bearings.size());
  }

  int size() const { return bearings_.size(); }
  bool sample(Rng& rng, std::array<int, 5>* sample) const {
    draw_sample(rng, size(), sample);
    return true;
  }
  int generate(const std::array<int, 5>& sample, std::array<ThreeViewMotion, 10>* motions) const;
  RansacScore score(const ThreeViewMotion& motion, double limit) const;
  void refine(ThreeViewMotion* motion) {
    constexpr int kMaxPoints = 100, kIterations = 4;
    collect_inliers(*motion, &inliers_);
    thin_out(kMaxPoints, &inliers_);
    refiner_.refine(bearings_, inliers_, kIterations, motion);
  }

  void collect_inliers(const ThreeViewMotion& motion, std::vector<int>* inliers) const {
    const Frames frames(motion);
    inliers->clear();
    for (int i = 0; i < size(); ++i) {
      if (error(frames, i) < 1) inliers->push_back(i);
    }
  }

 private:
  struct Frames {
    Matrix3d r1, r2;
    Vector3d t1, t2;
    explicit Frames(const ThreeViewMotion& motion)
        : r1(motion.cam1_from_cam0.rotation.toRotationMatrix()),
          r2(motion.cam2_from_cam0.rotation.toRotationMatrix()),
          t1(motion.cam1_from_cam0.translation),
          t2(motion.cam2_from_cam0.translation) {}
  };

  static double squared_tangent(const Vector3d& bearing, const Vector3d& seen) {
    const double along = bearing.dot(seen);
    return along > 0 ? std::max(0.0, seen.squaredNorm() - along * along) / (along * along) : 1e9;
  }

  // 1 at the limit of an inlier. The point lies on the ray of view 0, at the distance that fits view 2.
  double error(const Frames& f, int i) const {
    const Vector3d &b0 = bearings_.views[0][i], &b1 = bearings_.views[1][i], &b2 = bearings_.views[2][i];
    const double rho = inverse_distance(f.r2, f.t2, b0, b2);
    return scale_ *
           (squared_tangent(b2, f.r2 * b0 + rho * f.t2) + squared_tangent(b1, f.r1 * b0 + rho * f.t1));
  }

  ThreeViewBearings bearings_;
  double scale_;
  std::vector<int> inliers_;
  ThreeViewRefiner refiner_;
};

int MotionRansac::generate(const std::array<int, 5>& sample, std::array<ThreeViewMotion, 10>* motions) const {
  FiveBearings b;
  for (int v = 0; v < 3; ++v) {
    for (int i = 0; i < 5; ++i) b[v][i] = bearings_.views[v][sample[i]];
  }
  return five_point_motions(b, motions);
}

RansacScore MotionRansac::score(const ThreeViewMotion& motion, double limit) const {
  const Frames frames(motion);
  return truncated_score(size(), limit, [&](int i) { return error(frames, i); });
}

// Radians between the directions of translation.
double angle_apart(const ThreeViewMotion& a, const ThreeViewMotion& b) {
  return angle_between(a.cam2_from_cam0.inverse().translation, b.cam2_from_cam0.inverse().translation);
}

bool differ(const ThreeViewMotion& a, const ThreeViewMotion& b) {
  constexpr double kMinAngle = 0.03;
  return angle_apart(a, b) > kMinAngle;
}

// Triangulates every match from the three views and decides on the inliers; fills points, marks and figures.
void map_points(const ThreeViewBearings& bearings, double max_error, ThreeViewStart* start) {
  const Rigid3 cam0_from_cam1 = start->cam1_from_cam0.inverse(),
               cam0_from_cam2 = start->cam2_from_cam0.inverse();
  std::vector<double> parallax;
  double squared = 0;
  start->inlier_count = 0;
  for (int i = 0; i < bearings.size(); ++i) {
    const Vector3d in_cam0 = cam0_from_cam2.rotation * bearings.views[2][i];
    const std::array<Ray, 3> rays = {
        Ray{Vector3d::Zero(), bearings.views[0][i]},
        Ray{cam0_from_cam1.translation, cam0_from_cam1.rotation * bearings.views[1][i]},
        Ray{cam0_from_cam2.translation, in_cam0}};
    Triangulation point;
    start->inlier[i] = triangulate(rays, &point) && point.max_angle <= max_error;
    if (!start->inlier[i]) continue;
    start->points_in_cam0[i] = point.point;
    ++start->inlier_count;
    squared += point.rms_angle * point.rms_angle;
    parallax.push_back(angle_between(in_cam0, bearings.views[0][i]));
  }
  start->median_parallax = median_of(&parallax);
  start->rms_error = std::sqrt(squared / std::max(1, start->inlier_count));
}

// The plane n . X = 1 that fits the points of a motion best, in the frame of view 0, by their inverse
// distances.
bool fit_plane(const ThreeViewBearings& bearings, std::span<const int> inliers, const ThreeViewMotion& motion,
               Vector3d* plane) {
  const Matrix3d rotation = motion.cam2_from_cam0.rotation.toRotationMatrix();
  Matrix3d a = Matrix3d::Zero();
  Vector3d b = Vector3d::Zero();
  for (const int i : inliers) {
    const Vector3d& bearing = bearings.views[0][i];
    a += bearing * bearing.transpose();
    b += bearing *
         inverse_distance(rotation, motion.cam2_from_cam0.translation, bearing, bearings.views[2][i]);
  }
  *plane = a.ldlt().solve(b);
  return plane->allFinite() && plane->norm() > 1e-6;
}

// The other motion from view 0 to view 2 that moves the points of a plane the same way. With the homography
// H = R (I + s n^T), s = R^T t, H^T H = I + n m^T + m n^T, m = s + |s|^2 n / 2: n and m may change places.
bool planar_twin(const Rigid3& cam2_from_cam0, const Vector3d& n, Rigid3* twin) {
  const Matrix3d rotation = cam2_from_cam0.rotation.toRotationMatrix();
  const Vector3d s = rotation.transpose() * cam2_from_cam0.translation;
  const Vector3d m = s + 0.5 * s.squaredNorm() * n;
  // The twin's s' = n - y m / 2 with y = |s'|^2.
  const double a = 0.25 * m.squaredNorm(), b = 1 + n.dot(m), c = n.squaredNorm();
  const double discriminant = b * b - 4 * a * c;
  if (!(discriminant >= 0 && a > 1e-12)) return false;
  double best = 1e-6;  // both motions have the same determinant
  bool found = false;
  for (const double sign : {-1.0, 1.0}) {
    const Vector3d s2 = n - 0.5 * (b + sign * std::sqrt(discriminant)) / (2 * a) * m;
    const double difference = std::abs(s2.dot(m) - s.dot(n));
    if (!(difference < best * (1 + std::abs(s.dot(n)))) || std::abs(1 + s2.dot(m)) < 1e-9) continue;
    best = difference;
    const Matrix3d r2 = rotation * (Matrix3d::Identity() + s * n.transpose()) *
                        (Matrix3d::Identity() - s2 * m.transpose() / (1 + s2.dot(m)));
    twin->rotation = Eigen::Quaterniond(r2).normalized();
    twin->translation = (r2 * s2).normalized();
    found = true;
  }
  // (s', m) and (-s', -m) are one homography: the plane lies in front where m points.
  if (m.dot(n) < 0) twin->translation = -twin->translation;
  return found && twin->rotation.coeffs().allFinite() && twin->translation.allFinite();
}

double cost_of(const ThreeViewMotion& motion, const MotionRansac& motions) {
  return motions.score(motion, std::numeric_limits<double>::infinity()).cost;
}

// The second motion that coplanar points allow, refined on the inliers; infinite cost when there is none.
double find_rival(const ThreeViewBearings& bearings, std::span<const int> inliers,
                  const ThreeViewMotion& best, const MotionRansac& motions, ThreeViewMotion* rival) {
  constexpr int kResections = 10, kIterations = 15;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  Vector3d plane;
  ThreeViewMotion candidate;
  if (!fit_plane(bearings, inliers, best, &plane)) return kNone;
  if (!planar_twin(best.cam2_from_cam0, plane, &candidate.cam2_from_cam0)) return kNone;
  const Matrix3d rotation = candidate.cam2_from_cam0.rotation.toRotationMatrix();
  RansacScore score;
  std::array<Vector3d, 5> b1, points;
  std::array<int, 5> sample;
  Rng rng(inliers.size());
  for (int k = 0; k < kResections; ++k) {
    draw_sample(rng, static_cast<int>(inliers.size()), &sample);
    for (int j = 0; j < 5; ++j) {
      const int i = inliers[sample[j]];
      const double rho = inverse_distance(rotation, candidate.cam2_from_cam0.translation,
                                          bearings.views[0][i], bearings.views[2][i]);
      b1[j] = bearings.views[1][i];
      points[j] = bearings.views[0][i] / std::max(rho, 1e-6);
    }
    if (!resect(b1, points, &candidate.cam1_from_cam0)) continue;
    const RansacScore other = motions.score(candidate, score.cost);
    if (other.cost < score.cost) score = other, *rival = candidate;
  }
  if (!std::isfinite(score.cost)) return kNone;
  const double cost = ThreeViewRefiner().refine(bearings, inliers, kIterations, rival);
  return differ(*rival, best) ? cost : kNone;
}

// Refines the search's best motion on its inliers and makes sure that no other fits them better. Where many
// more of all matches agree with one of the two, these judge: squares count a point behind a camera too.
ThreeViewMotion best_of_two(const ThreeViewBearings& bearings, std::span<const int> inliers,
                            const MotionRansac& motions, ThreeViewMotion motion, double* rival_cost) {
  constexpr int kIterations = 15;
  constexpr double kManyMore = 0.02;  // of the matches
  const double cost = ThreeViewRefiner().refine(bearings, inliers, kIterations, &motion);
  ThreeViewMotion rival;
  const double other = find_rival(bearings, inliers, motion, motions, &rival);
  *rival_cost = std::isfinite(other) ? std::max(other, cost) / std::min(other, cost) : 0;
  if (!std::isfinite(other)) return motion;
  const double more = cost_of(motion, motions) - cost_of(rival, motions);
  const bool is_clear = std::abs(more) > kManyMore * bearings.size();
  return (is_clear ? more > 0 : other < cost) ? rival : motion;
}

// Takes a motion that was refined on the inliers of the search, and refines it once more on its own.
void polish(const ThreeViewBearings& bearings, double max_error, ThreeViewMotion motion,
            ThreeViewStart* start) {
  constexpr int kIterations = 15;
  const auto take = [&] {
    start->cam1_from_cam0 = motion.cam1_from_cam0;
    start->cam2_from_cam0 = motion.cam2_from_cam0;
    map_points(bearings, max_error, start);
  };
  take();
  std::vector<int> inliers;
  for (int i = 0; i < bearings.size(); ++i) {
    if (start->inlier[i]) inliers.push_back(i);
  }
  ThreeViewRefiner().refine(bearings, inliers, kIterations, &motion);
  take();
}

double enough_inliers(int matches, const ThreeViewOptions& options) {
  return std::max<double>(options.min_inliers, options.min_inlier_ratio * matches);
}

// The difference D of two sums of squares, in variances of a residual, is known to 2 sqrt(D): it is beyond
// chance where it is more than 36. Of a point three of six residuals tell its place.
double least_rival_cost(int inliers, const ThreeViewOptions& options) {
  constexpr double kBeyondChance = 36;
  return std::max(options.min_rival_cost, 1 + kBeyondChance / (3.0 * inliers));
}

StartProblem diagnose(const ThreeViewStart& start, int matches, const ThreeViewOptions& options) {
  const double enough = enough_inliers(matches, options);
  const bool rotation = start.rotation_inliers >= enough &&
                        start.rotation_inliers >= options.rotation_advantage * start.inlier_count;
  if (rotation) return StartProblem::kRotationOnly;
  if (start.inlier_count < enough) return StartProblem::kTooFewInliers;
  if (start.rival_cost > 0 && start.rival_cost < least_rival_cost(start.inlier_count, options))
    return StartProblem::kAmbiguous;
  if (start.least_parallax < options.min_parallax) return StartProblem::kTooLittleParallax;
  return StartProblem::kNone;
}

ThreeViewMotion motion_of(const ThreeViewStart& start) {
  return {start.cam1_from_cam0, start.cam2_from_cam0};
}

// What came of a search, refined and judged.
void judge(const ThreeViewBearings& bearings, const ThreeViewOptions& options, ThreeViewMotion motion,
           const MotionRansac& motions, ThreeViewStart* start) {
  std::vector<int> inliers;
  motions.collect_inliers(motion, &inliers);
  if (inliers.size() >= 5) {
    motion = best_of_two(bearings, inliers, motions, motion, &start->rival_cost);
  }
  polish(bearings, options.max_error, motion, start);
  start->least_parallax = start->median_parallax;
  start->problem = diagnose(*start, bearings.size(), options);
}

// What a search ended at.
struct End {
  ThreeViewMotion motion;
  int inliers = 0;
  double rms_error = 0, parallax = 0;
};

// Holds the ends of other searches against the best. By their matches and errors, since in the truncated cost
// one match more outweighs the errors of a hundred.
void weigh(std::span<const End> others, int matches, const ThreeViewOptions& options, ThreeViewStart* start) {
  constexpr double kAsMany = 0.95, kAboutAsWell = 1.5;  // parts of the matches, times the squared errors
  // Of few matches a few more or less are chance.
  const double as_many = std::min(kAsMany, 1 - 1 / std::sqrt(start->inlier_count));
  constexpr double kHardlyFewer = 0.98, kHardlyWorse = 1.02;
  constexpr double kFarApart = 0.2;  // radians: nearer ones come to the same as views are added
  for (const End& other : others) {
    const double share = static_cast<double>(other.inliers) / start->inlier_count;
    const double ratio = std::pow(other.rms_error / start->rms_error, 2);
    if (share < as_many || ratio > kAboutAsWell) continue;
    start->least_parallax = std::min(start->least_parallax, other.parallax);
    if (share < kHardlyFewer || ratio > kHardlyWorse) continue;
    if (angle_apart(other.motion, motion_of(*start)) > kFarApart) start->rival_cost = std::max(1.0, ratio);
  }
  start->problem = diagnose(*start, matches, options);
}

// Searches that begin elsewhere: a better motion is taken, and what others there are is held against it.
void search_again(const ThreeViewBearings& bearings, const ThreeViewOptions& options,
                  const ThreeViewStart& empty, RansacOptions search, MotionRansac& motions,
                  ThreeViewStart* start) {
  constexpr double kHopeless = 28;  // times the error: of less parallax more searches tell nothing
  const int most = std::max(options.searches, options.searches_in_doubt);
  double cost = cost_of(motion_of(*start), motions);
  std::vector<End> others;
  for (int k = 1, searches = most; k < searches; ++k) {
    search.seed += kOtherSeed;
    ThreeViewMotion motion;
    const RansacReport report = ransac(motions, search, &motion);
    // What was found where the first is would come to the same.
    if (!report.found() || !differ(motion, motion_of(*start))) continue;
    ThreeViewStart other = empty;
    other.iterations = report.iterations;
    judge(bearings, options, motion, motions, &other);
    if (!differ(motion_of(other), motion_of(*start))) continue;
    double other_cost = cost_of(motion_of(other), motions);
    if (other_cost < cost) std::swap(other, *start), std::swap(other_cost, cost);
    others.push_back({motion_of(other), other.inlier_count, other.rms_error, other.median_parallax});
    ThreeViewStart weighed = *start;
    weigh(others, bearings.size(), options, &weighed);
    const bool open = weighed.ok() && weighed.least_parallax > kHopeless * weighed.rms_error;
    searches = open ? most : options.searches;
  }
  weigh(others, bearings.size(), options, start);
}

}  // namespace

ThreeViewStart start_from_three_views(std::span<const Vector3d> bearings0,
                                      std::span<const Vector3d> bearings1,
                                      std::span<const Vector3d> bearings2, const ThreeViewOptions& options) {
  const ThreeViewBearings bearings{{bearings0, bearings1, bearings2}};
  const int count = bearings.size();
  ThreeViewStart start;
  start.points_in_cam0.assign(count, Vector3d::Zero());
  start.inlier.assign(count, 0);
  if (count < std::max(5, options.min_matches)) return start;

  std::vector<double> displacement(count);
  for (int i = 0; i < count; ++i) displacement[i] = angle_between(bearings0[i], bearings2[i]);
  start.median_displacement = median_of(&displacement);
  start.problem = StartProblem::kNoMotion;
  if (!(start.median_displacement >= options.min_displacement)) return start;

  RansacOptions search{.max_iterations = options.max_iterations,
                       .confidence = options.confidence,
                       .seed = options.seed,
                       .stream = options.stream};
  start.rotation_inliers =
      rotation_inliers(bearings0, bearings2, options.max_error, enough_inliers(count, options), search);

  MotionRansac motions(bearings, options.max_error);
  const ThreeViewStart empty = start;
  ThreeViewMotion motion;
  RansacReport report = ransac(motions, search, &motion);
  start.iterations = report.iterations;
  if (!report.found()) {
    start.problem = diagnose(start, count, options);
    return start;
  }
  judge(bearings, options, motion, motions, &start);
  if (start.ok()) search_again(bearings, options, empty, search, motions, &start);
  return start;
}

std::string describe(const ThreeViewStart& start) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const size_t matches = start.inlier.size();
  char text[200] = "";
  switch (start.problem) {
    case StartProblem::kNone:
      std::snprintf(text, sizeof text, "%d of %zu matches agree, median parallax %.2f degrees",
                    start.inlier_count, matches, kDegrees * start.median_parallax);
      break;
    case StartProblem::kTooFewMatches:
      std::snprintf(text, sizeof text, "too few matches (%zu) over three views", matches);
      break;
    case StartProblem::kNoMotion:
      std::snprintf(text, sizeof text, "no motion: the median match moves %.2f degrees",
                    kDegrees * start.median_displacement);
      break;
    case StartProblem::kRotationOnly:
      std::snprintf(text, sizeof text,
                    "rotation without translation: it explains %d of %zu matches, a full motion %d",
                    start.rotation_inliers, matches, start.inlier_count);
      break;
    case StartProblem::kTooFewInliers:
      std::snprintf(text, sizeof text, "no rigid motion explains the matches: %d of %zu agree",
                    start.inlier_count, matches);
      break;
    case StartProblem::kAmbiguous:
      std::snprintf(text, sizeof text,
                    "ambiguous: a second motion fits %d of %zu matches with %.2f times the cost",
                    start.inlier_count, matches, start.rival_cost);
      break;
    case StartProblem::kTooLittleParallax:
      std::snprintf(text, sizeof text, "too little parallax: median %.2f degrees",
                    kDegrees * start.least_parallax);
      break;
    case StartProblem::kTwoMotions:
      std::snprintf(text, sizeof text,
                    "two motions explain about as much of the image: one %d of %zu matches",
                    start.inlier_count, matches);
      break;
  }
  return text;
}

}  // namespace raysfm
