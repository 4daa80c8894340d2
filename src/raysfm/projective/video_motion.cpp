#include "raysfm/projective/video_motion.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "raysfm/core/median.h"
#include "raysfm/projective/eight_point.h"
#include "raysfm/projective/match_estimator.h"
#include "raysfm/projective/view_pair.h"

namespace raysfm {
namespace {

constexpr int kMotionPairs = 12;
constexpr int kMaxMotionSamples = 500;
// An error of a homography may be larger: a lens that bends lines breaks it where the camera only turns.
constexpr double kHomographyError = 0.006;  // of the image's larger side
// Of what agrees with an epipolar geometry, by a turn through one lens: the turns of three rendered films
// explain 0.96 to 0.99, of two where a walker looks about 0.84 and 0.89, fr1-rpy 0.85, the kitchen 0.56. And
// the part of pairs that turn.
constexpr double kTurned = 0.95, kNearlyTurned = 0.8, kAllTurn = 0.9;
// Of what agrees with an epipolar geometry, by such a homography: less is no turn through any lens.
constexpr double kMayTurn = 0.5;

struct Homography {
  static constexpr int kSampleSize = 4, kRounds = 2;
  static bool fit(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                  Eigen::Matrix3d* model) {
    return homography_from_points(a, b, model);
  }
  static double error2(const Eigen::Matrix3d& model, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return ((model * a.homogeneous()).hnormalized() - b).squaredNorm();
  }
};

// Pixels move along lines through one point e: the fundamental matrix is that of the cross product with e.
struct Translation {
  static constexpr int kSampleSize = 2, kRounds = 2;
  static bool fit(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                  Eigen::Matrix3d* model) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < a.size(); ++i) {
      const Eigen::Vector3d line = a[i].homogeneous().cross(b[i].homogeneous());
      const double length = line.norm();
      if (length > 0) sum += line * line.transpose() / (length * length) * (b[i] - a[i]).squaredNorm();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(sum);
    const Eigen::Vector3d e = eigen.eigenvectors().col(0);
    *model << 0, -e.z(), e.y(), e.z(), 0, -e.x(), -e.y(), e.x(), 0;
    return eigen.eigenvalues()[1] > 1e-12 * eigen.eigenvalues()[2];
  }
  static double error2(const Eigen::Matrix3d& model, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return sampson_error2(model, a, b);
  }
};

template <typename Relation>
int inliers(const PairMatches& matches, double max_error, uint64_t seed, Eigen::Matrix3d* model) {
  MatchEstimator<Relation> estimator(matches, max_error);
  const RansacReport report =
      ransac(estimator, {.max_iterations = kMaxMotionSamples, .seed = seed, .stream = 0}, model);
  return report.found() ? report.score.inliers : 0;
}

// K R K^-1 has the eigenvalues of R, all of one modulus.
bool turns(const Eigen::Matrix3d& homography) {
  constexpr double kTolerance = 0.03;
  const Eigen::Vector3d moduli = homography.eigenvalues().cwiseAbs();
  return moduli.maxCoeff() < (1 + kTolerance) * moduli.minCoeff();
}

// What three quarters of the values exceed: a motion is hopeless where there is no other in the film.
double lower_quartile(std::vector<double>* values) {
  if (values->empty()) return 0;
  const auto quarter = values->begin() + static_cast<ptrdiff_t>(values->size() / 4);
  std::ranges::nth_element(*values, quarter);
  return *quarter;
}

// Matches of a pair, and how many of them agree with an epipolar geometry.
struct Pair {
  PairMatches matches;
  int agreeing = 0;
};

// As an image would show them whose lens does not bend lines, by the division model (Fitzgibbon 2001).
std::vector<Eigen::Vector2d> unbent(std::span<const Eigen::Vector2d> pixels, const Eigen::Vector2d& size,
                                    double lambda) {
  const Eigen::Vector2d middle = 0.5 * (size - Eigen::Vector2d::Ones());
  std::vector<Eigen::Vector2d> straight;
  for (const Eigen::Vector2d& p : pixels) {
    const Eigen::Vector2d d = p - middle;
    straight.push_back(middle + d / (1 + lambda * d.squaredNorm() / (0.25 * size.squaredNorm())));
  }
  return straight;
}

// How well turns explain pairs through one lens for all that may bend lines.
struct Turns {
  double explained = 0;  // of the agreeing matches, by a homography: the median over pairs
  double rotation = 0;   // of the pairs, those whose homography has the eigenvalues of a rotation
};

Turns turns_through(double lambda, std::span<const Pair> pairs, const Eigen::Vector2d& size, double max_error,
                    uint64_t seed) {
  Turns found;
  std::vector<double> shares;
  for (const Pair& pair : pairs) {
    const PairMatches straight{
        {}, unbent(pair.matches.a, size, lambda), unbent(pair.matches.b, size, lambda)};
    Eigen::Matrix3d model;
    shares.push_back(double(inliers<Homography>(straight, max_error, seed, &model)) / pair.agreeing);
    found.rotation += turns(model) / double(pairs.size());
  }
  found.explained = median_of(&shares);
  return found;
}

// Through the lens through which most is explained.
Turns best_turns(std::span<const Pair> pairs, const Eigen::Vector2d& size, double max_error, uint64_t seed) {
  constexpr double kFirstStep = 0.2, kLastStep = 0.02;
  double at = 0;
  Turns best = turns_through(at, pairs, size, max_error, seed);
  for (double step = kFirstStep; step > kLastStep; step *= 0.5) {
    for (const double lambda : {at - 2 * step, at - step, at + step}) {
      const Turns found = turns_through(lambda, pairs, size, max_error, seed);
      if (found.explained > best.explained) best = found, at = lambda;
    }
  }
  return best;
}

}  // namespace

MotionShares motion_shares(const PointTracks& tracks, std::span<const int> images, double max_error_px,
                           uint64_t seed) {
  const ImageObservations observations(tracks);
  const double side = tracks.image_size.maxCoeff();
  std::vector<double> homography, translation, moved;
  std::vector<Pair> pairs;
  const size_t step = 1 + images.size() / (kMotionPairs + 1);
  for (size_t first = 0; first + 1 < images.size(); first += step) {
    const int partner = farthest_partner(observations, images, first);
    if (partner < 0) continue;
    PairMatches matches = observations.matches(images[first], partner);
    std::vector<double> distances;
    for (size_t i = 0; i < matches.a.size(); ++i) distances.push_back((matches.b[i] - matches.a[i]).norm());
    moved.push_back(median_of(&distances) / side);
    ViewPair epipolar;
    if (!fundamental_ransac(matches, max_error_px, kMaxMotionSamples, seed, first, &epipolar)) continue;
    Eigen::Matrix3d model;
    homography.push_back(
        double(inliers<Homography>(matches, std::max(max_error_px, kHomographyError * side), seed, &model)) /
        epipolar.inliers);
    translation.push_back(double(inliers<Translation>(matches, max_error_px, seed, &model)) /
                          epipolar.inliers);
    pairs.push_back({std::move(matches), epipolar.inliers});
  }
  MotionShares shares;
  shares.homography = lower_quartile(&homography);
  shares.translation = lower_quartile(&translation);
  shares.moved = median_of(&moved);
  shares.pairs = static_cast<int>(homography.size());
  if (shares.homography > kMayTurn) {
    const Turns best = best_turns(pairs, tracks.image_size, max_error_px, seed);
    shares.turn = best.explained;
    shares.rotation = best.rotation;
  }
  return shares;
}

bool nearly_turns(const MotionShares& shares) {
  return shares.turn > kNearlyTurned && shares.rotation > kAllTurn;
}

HopelessMotion hopeless_motion(const MotionShares& shares) {
  constexpr double kStill = 0.01, kAll = 0.97;
  if (shares.pairs == 0 || shares.moved < kStill) {
    return {"no motion", "the image hardly moves while corners can be followed"};
  }
  if (shares.turn > kTurned && shares.rotation > kAllTurn) {
    return {"pure rotation", "one turn about its centre explains what the camera sees, there is no parallax"};
  }
  if (shares.homography > kAll) {
    return {"planar scene", "a homography relates every two images, and it is not that of a turn"};
  }
  if (shares.translation > kAll) {
    return {"pure translation", "all points move along lines through one point, the camera does not turn"};
  }
  return {};
}

}  // namespace raysfm
