#include "raysfm/ray_lenses/turn_lens.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "raysfm/core/median.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/projective/view_pair.h"
#include "raysfm/robust/ransac.h"
#include "raysfm/robust/rotation_ransac.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kMostPairs = 24;
constexpr std::size_t kFewestPairs = 4;
constexpr std::size_t kMatchesOfPair = 150;
// Of focal lengths that are tried first, parts of the image's larger side, and the factor between two.
constexpr double kShortest = 0.25, kLongest = 5, kFactor = 1.2;
// Pixels within which a match agrees while the lens bends no lines yet, part of the image's larger side.
constexpr double kFirstError = 0.006;
constexpr double kLeastExplained = 0.6;
// Of k1 and k2 before the images are asked, at the focal lengths of most cameras.
constexpr double kBentSigma = 0.3;
// Pixels of an error that all matches of a pair may share: what priors are weighed against.
constexpr double kSharedError = 3;
// A fisheye must explain what a perspective lens does with so much less.
constexpr double kClearlyBetter = 0.9;

// log f, cx and cy from the middle as parts of the image's larger side, k1, k2.
constexpr int kNumbers = 5;
using Numbers = Eigen::Matrix<double, kNumbers, 1>;
using NumbersSquare = Eigen::Matrix<double, kNumbers, kNumbers>;

enum class LensKind : uint8_t { kPerspective, kFisheye };

Camera camera_of(LensKind kind, const Numbers& n, const Vector2d& size) {
  const double f = std::exp(n[0]), side = size.maxCoeff();
  const Vector2d centre = 0.5 * (size - Vector2d::Ones()) + side * n.segment<2>(1);
  Camera camera;
  camera.width = static_cast<int>(size.x());
  camera.height = static_cast<int>(size.y());
  if (kind == LensKind::kFisheye) {
    camera.model = KannalaBrandt{f, f, centre.x(), centre.y(), n[3], n[4]};
  } else {
    camera.model = Radtan{f, f, centre.x(), centre.y(), n[3], n[4]};
  }
  return camera;
}

// Pairs of images as far apart as tracks allow, and half as far, of evenly spread matches.
std::vector<PairMatches> pairs_of(const PointTracks& tracks) {
  const ImageObservations observations(tracks);
  const int images = tracks.image_count, step = 1 + 2 * images / kMostPairs;
  std::vector<int> all_images(images);
  std::iota(all_images.begin(), all_images.end(), 0);
  std::vector<PairMatches> pairs;
  const auto add = [&](int a, int b) {
    PairMatches all = observations.matches(a, b), few;
    const std::size_t stride = 1 + all.a.size() / kMatchesOfPair;
    for (std::size_t i = 0; i < all.a.size(); i += stride) {
      few.a.push_back(all.a[i]);
      few.b.push_back(all.b[i]);
    }
    pairs.push_back(std::move(few));
  };
  for (int first = 0; first + 1 < images; first += step) {
    const int last = farthest_partner(observations, all_images, first);
    if (last > first) add(first, last);
    if (last > first + 2) add(first, (first + last) / 2);
  }
  return pairs;
}

// Rotations of pairs and the numbers of a lens, for levenberg_marquardt(). Squared pixels, truncated.
class TurnProblem {
 public:
  TurnProblem(std::vector<PairMatches> pairs, LensKind kind, const Vector2d& size, double centre_sigma)
      : pairs_(std::move(pairs)), kind_(kind), size_(size), rotations_(pairs_.size(), Matrix3d::Identity()) {
    prior_ << 0, 1 / centre_sigma, 1 / centre_sigma, 1 / kBentSigma, 1 / kBentSigma;
    prior_ *= kSharedError;
  }

  void set_max_error(double pixels) { max_error2_ = pixels * pixels; }
  void set_focal(double focal) { numbers_ << std::log(focal), 0, 0, 0, 0; }
  Camera camera() const { return camera_of(kind_, numbers_, size_); }

  // The rotations that most matches agree with, through the present lens.
  void find_rotations(uint64_t seed);
  double cost() const { return cost_of(numbers_, rotations_); }
  // With that of pairs that were dropped, of which nothing agrees.
  double whole_cost() const { return cost() + dropped_ * max_error2_; }
  // Part of the matches of a pair that agree.
  double explained(std::size_t pair) const;
  // Of all that there were at first.
  double explained() const;
  // Pairs of which so much agrees stay.
  void keep_explained(double least);
  std::size_t pairs() const { return pairs_.size(); }
  NumbersSquare covariance();

  double linearize();
  LmStep solve(double lambda);
  LmTrial evaluate(bool linearize);
  void accept() { numbers_ = moved_numbers_, rotations_ = moved_rotations_; }

 private:
  // Equations of a pair: lens by lens, lens by rotation, rotation by rotation.
  struct Equations {
    NumbersSquare lens = NumbersSquare::Zero();
    Eigen::Matrix<double, kNumbers, 3> mixed = Eigen::Matrix<double, kNumbers, 3>::Zero();
    Matrix3d turn = Matrix3d::Zero();
    Numbers lens_gradient = Numbers::Zero();
    Vector3d turn_gradient = Vector3d::Zero();
  };

  // False where the lens does not see it.
  static bool residual(const Camera& camera, const Matrix3d& rotation, const Vector2d& a, const Vector2d& b,
                       Vector2d* r) {
    Ray ray;
    Vector2d pixel;
    if (!camera.ray(a, &ray) || !camera.project(rotation * ray.direction, &pixel)) return false;
    *r = pixel - b;
    return true;
  }
  bool derive(const Matrix3d& rotation, const Vector2d& a, const Vector2d& b, Vector2d* r,
              Eigen::Matrix<double, 2, kNumbers>* by_lens, Eigen::Matrix<double, 2, 3>* by_turn) const;
  double cost_of(const Numbers& numbers, const std::vector<Matrix3d>& rotations) const;

  std::vector<PairMatches> pairs_;
  LensKind kind_;
  Vector2d size_;
  Numbers prior_;  // pixels over standard deviations
  double max_error2_ = 1;
  double dropped_ = 0;  // matches
  Numbers numbers_ = Numbers::Zero(), moved_numbers_ = Numbers::Zero();
  std::vector<Matrix3d> rotations_, moved_rotations_;
  std::vector<Equations> equations_;
  Camera camera_;                             // of the linearisation
  std::array<Camera, kNumbers> more_, less_;  // with one number changed a little
};

constexpr double kStep = 1e-5;  // of a number, for its derivatives

void TurnProblem::find_rotations(uint64_t seed) {
  const Camera camera = this->camera();
  const double error = std::sqrt(max_error2_) / std::exp(numbers_[0]);
  std::vector<Vector3d> before, after;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    before.clear(), after.clear();
    for (std::size_t i = 0; i < pairs_[p].a.size(); ++i) {
      Ray a, b;
      if (!camera.ray(pairs_[p].a[i], &a) || !camera.ray(pairs_[p].b[i], &b)) continue;
      before.push_back(a.direction), after.push_back(b.direction);
    }
    RotationRansac search(before, after, error);
    rotations_[p] = Matrix3d::Identity();
    ransac(search, {.max_iterations = 200, .seed = seed, .stream = p}, &rotations_[p]);
  }
}

double TurnProblem::cost_of(const Numbers& numbers, const std::vector<Matrix3d>& rotations) const {
  const Camera camera = camera_of(kind_, numbers, size_);
  double cost = prior_.cwiseProduct(numbers).tail<kNumbers - 1>().squaredNorm();
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    for (std::size_t i = 0; i < pairs_[p].a.size(); ++i) {
      Vector2d r;
      const bool is_seen = residual(camera, rotations[p], pairs_[p].a[i], pairs_[p].b[i], &r);
      cost += is_seen ? std::min(max_error2_, r.squaredNorm()) : max_error2_;
    }
  }
  return cost;
}

double TurnProblem::explained(std::size_t pair) const {
  const Camera camera = this->camera();
  const PairMatches& matches = pairs_[pair];
  int agree = 0;
  for (std::size_t i = 0; i < matches.a.size(); ++i) {
    Vector2d r;
    agree +=
        residual(camera, rotations_[pair], matches.a[i], matches.b[i], &r) && r.squaredNorm() < max_error2_;
  }
  return static_cast<double>(agree) / static_cast<double>(matches.a.size());
}

double TurnProblem::explained() const {
  double agree = 0, all = dropped_;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    const auto matches = static_cast<double>(pairs_[p].a.size());
    agree += explained(p) * matches;
    all += matches;
  }
  return agree / all;
}

void TurnProblem::keep_explained(double least) {
  std::size_t kept = 0;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    if (explained(p) < least) {
      dropped_ += static_cast<double>(pairs_[p].a.size());
      continue;
    }
    std::swap(pairs_[kept], pairs_[p]);
    std::swap(rotations_[kept++], rotations_[p]);
  }
  pairs_.resize(kept);
  rotations_.resize(kept);
}

bool TurnProblem::derive(const Matrix3d& rotation, const Vector2d& a, const Vector2d& b, Vector2d* r,
                         Eigen::Matrix<double, 2, kNumbers>* by_lens,
                         Eigen::Matrix<double, 2, 3>* by_turn) const {
  Ray ray;
  Vector2d pixel;
  Eigen::Matrix<double, 2, 3> by_point;
  if (!camera_.ray(a, &ray)) return false;
  const Vector3d turned = rotation * ray.direction;
  if (!camera_.project(turned, &pixel, &by_point)) return false;
  *r = pixel - b;
  if (!(r->squaredNorm() < max_error2_)) return false;
  *by_turn = -by_point * skew(turned);
  for (int k = 0; k < kNumbers; ++k) {
    Vector2d more, less;
    if (!residual(more_[k], rotation, a, b, &more) || !residual(less_[k], rotation, a, b, &less))
      return false;
    by_lens->col(k) = (more - less) / (2 * kStep);
  }
  return true;
}

double TurnProblem::linearize() {
  camera_ = camera();
  for (int k = 0; k < kNumbers; ++k) {
    const Numbers step = kStep * Numbers::Unit(k);
    more_[k] = camera_of(kind_, numbers_ + step, size_);
    less_[k] = camera_of(kind_, numbers_ - step, size_);
  }
  equations_.assign(pairs_.size(), {});
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    Equations& e = equations_[p];
    for (std::size_t i = 0; i < pairs_[p].a.size(); ++i) {
      Vector2d r;
      Eigen::Matrix<double, 2, kNumbers> by_lens;
      Eigen::Matrix<double, 2, 3> by_turn;
      if (!derive(rotations_[p], pairs_[p].a[i], pairs_[p].b[i], &r, &by_lens, &by_turn)) continue;
      e.lens += by_lens.transpose() * by_lens;
      e.mixed += by_lens.transpose() * by_turn;
      e.turn += by_turn.transpose() * by_turn;
      e.lens_gradient += by_lens.transpose() * r;
      e.turn_gradient += by_turn.transpose() * r;
    }
  }
  return cost();
}

LmStep TurnProblem::solve(double lambda) {
  NumbersSquare lens = NumbersSquare::Zero();
  Numbers gradient = Numbers::Zero();
  for (const Equations& e : equations_) lens += e.lens, gradient += e.lens_gradient;
  lens.diagonal() += prior_.cwiseAbs2();
  gradient += prior_.cwiseAbs2().cwiseProduct(numbers_);
  const Numbers full_gradient = gradient;
  lens.diagonal() *= 1 + lambda;
  std::vector<Matrix3d> inverses;
  for (const Equations& e : equations_) {
    Matrix3d turn = e.turn;
    turn.diagonal() *= 1 + lambda;
    turn.diagonal().array() += 1e-9;
    inverses.push_back(turn.inverse());
    lens -= e.mixed * inverses.back() * e.mixed.transpose();
    gradient -= e.mixed * inverses.back() * e.turn_gradient;
  }
  const Eigen::LDLT<NumbersSquare> ldlt(lens);
  if (!ldlt.isPositive()) return {};
  const Numbers step = -ldlt.solve(gradient);
  if (!step.allFinite()) return {};
  moved_numbers_ = numbers_ + step;
  moved_rotations_ = rotations_;
  double decrease = -full_gradient.dot(step);
  for (std::size_t p = 0; p < equations_.size(); ++p) {
    const Equations& e = equations_[p];
    const Vector3d turn = -inverses[p] * (e.turn_gradient + e.mixed.transpose() * step);
    moved_rotations_[p] = exp_so3(turn).toRotationMatrix() * rotations_[p];
    decrease -= e.turn_gradient.dot(turn);
  }
  return {.valid = true, .decrease = std::max(decrease, 1e-12)};
}

LmTrial TurnProblem::evaluate(bool /*linearize*/) {
  return {.before = cost(), .after = cost_of(moved_numbers_, moved_rotations_)};
}

// Of the numbers, rotations eliminated, with errors that are a pair's as a whole (White's sandwich).
NumbersSquare TurnProblem::covariance() {
  linearize();
  NumbersSquare information = prior_.cwiseAbs2().asDiagonal(),
                spread = information * kSharedError * kSharedError;
  for (const Equations& e : equations_) {
    const Matrix3d inverse = (e.turn + 1e-9 * Matrix3d::Identity()).inverse();
    information += e.lens - e.mixed * inverse * e.mixed.transpose();
    const Numbers gradient = e.lens_gradient - e.mixed * inverse * e.turn_gradient;
    spread += gradient * gradient.transpose();
  }
  const NumbersSquare inverse = information.inverse();
  return inverse * spread * inverse;
}

// The lens of one kind that explains the pairs best, from all focal lengths.
TurnProblem best_lens(const std::vector<PairMatches>& pairs, LensKind kind, const Vector2d& size,
                      const TurnLensOptions& options) {
  const double side = size.maxCoeff(), wide = std::max(kFirstError * side, options.max_error_px);
  TurnProblem problem(pairs, kind, size, options.centre_sigma);
  problem.set_max_error(wide);
  double least = std::numeric_limits<double>::infinity(), best = side;
  for (double f = kShortest * side; f < kLongest * side; f *= kFactor) {
    problem.set_focal(f);
    problem.find_rotations(options.seed);
    const double cost = problem.cost();
    if (cost < least) least = cost, best = f;
  }
  problem.set_focal(best);
  problem.find_rotations(options.seed);
  for (const double error : {wide, std::sqrt(wide * options.max_error_px), options.max_error_px}) {
    problem.set_max_error(error);
    problem.keep_explained(kLeastExplained);
    if (problem.pairs() == 0) break;
    levenberg_marquardt(problem, {.max_iterations = 20});
  }
  return problem;
}

}  // namespace

std::optional<TurnLens> lens_of_turn(const PointTracks& tracks, const TurnLensOptions& options) {
  const std::vector<PairMatches> pairs = pairs_of(tracks);
  if (pairs.size() < kFewestPairs) return std::nullopt;
  TurnProblem perspective = best_lens(pairs, LensKind::kPerspective, tracks.image_size, options);
  TurnProblem fisheye = best_lens(pairs, LensKind::kFisheye, tracks.image_size, options);
  TurnProblem& best =
      fisheye.whole_cost() < kClearlyBetter * perspective.whole_cost() ? fisheye : perspective;
  if (best.pairs() < kFewestPairs) return std::nullopt;
  const NumbersSquare covariance = best.covariance();
  if (!covariance.allFinite()) return std::nullopt;
  TurnLens lens{.camera = best.camera()};
  lens.focal_sigma = std::sqrt(covariance(0, 0));
  lens.centre_sigma = std::sqrt(std::max(covariance(1, 1), covariance(2, 2)));
  lens.explained = best.explained();
  return lens;
}

}  // namespace raysfm
