#include "raysfm/uncalibrated/video_radial.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

constexpr double kWideStep = 0.03, kStep = 0.01;  // between the points of a parabola, at first and at last
constexpr int kMaxParabolas = 8;
constexpr double kMaxK1 = 0.4;  // farther, the parabolas do not hold

// The point that the distortion takes to m; false where there is none.
bool undistort(const RadialDistortion& radial, const Eigen::Vector2d& m, Eigen::Vector2d* ideal) {
  constexpr int kIterations = 10;
  *ideal = m;
  for (int i = 0; i < kIterations; ++i) {
    const Eigen::Matrix2d jacobian = radial.jacobian(*ideal);
    if (!(jacobian.determinant() > 0.1)) return false;
    *ideal -= jacobian.inverse() * (radial(*ideal) - m);
  }
  return (radial(*ideal) - m).norm() < 1e-9;
}

struct Trial {
  UncalibratedScene scene;
  LensAdjustmentSummary summary;
  double cost = INFINITY;
};

class Search {
 public:
  Search(const PointTracks& tracks, std::span<const double> weights, const LensAdjustmentOptions& options)
      : tracks_(tracks), weights_(weights), options_(options) {}

  // The distortion is that of the lenses in `from`.
  Trial trial(double k1, const UncalibratedScene& from) const {
    Trial trial;
    std::vector<double> weights(weights_.begin(), weights_.end());
    const PointTracks ideal = without_distortion(tracks_, from.lenses, {k1, 0}, &weights);
    LensAdjustmentOptions options = options_;
    options.loss.kind = RobustLoss::Kind::kNone;  // the weights have it in them
    options.with_sigma = false;
    options.lm.initial_damping = 1e-6;  // near the bottom
    trial.scene = from;
    auto summary = adjust_standard(ideal, weights, options, &trial.scene);
    if (!summary) return trial;
    trial.summary = std::move(*summary);
    trial.cost = trial.summary.lm.final_cost;
    return trial;
  }

 private:
  const PointTracks& tracks_;
  std::span<const double> weights_;
  const LensAdjustmentOptions& options_;
};

// Of the focal lengths, over the observations.
double mean_square_ratio(const PointTracks& tracks, std::span<const double> weights,
                         std::span<const Lens> before, std::span<const Lens> after) {
  double sum = 0;
  int count = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (weights[k] == 0) continue;
    sum += std::pow(after[tracks.image[k]].fx / before[tracks.image[k]].fx, 2), ++count;
  }
  return count > 0 ? sum / count : 1;
}

}  // namespace

PointTracks without_distortion(const PointTracks& tracks, std::span<const Lens> lenses,
                               const RadialDistortion& radial, std::vector<double>* weights) {
  PointTracks ideal = tracks;
  for (int k = 0; k < tracks.size(); ++k) {
    if ((*weights)[k] == 0) continue;
    const Lens& lens = lenses[tracks.image[k]];
    Eigen::Vector2d undistorted;
    if (!undistort(radial, lens.normalised(tracks.pixel[k]), &undistorted)) {
      (*weights)[k] = 0;
      continue;
    }
    ideal.pixel[k] = lens.pixel(undistorted);
    (*weights)[k] *= radial.jacobian(undistorted).determinant();
  }
  return ideal;
}

std::optional<RadialEstimate> estimate_radial(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options,
                                              const UncalibratedScene& scene) {
  const Search search(tracks, weights, options);
  Trial middle = search.trial(0, scene);
  const double without = middle.cost;
  double k1 = 0, curvature = 0;
  Trial sides[2];
  double step = kWideStep;
  for (int i = 0; i < kMaxParabolas; ++i) {
    sides[0] = search.trial(k1 - step, middle.scene);
    sides[1] = search.trial(k1 + step, middle.scene);
    curvature = (sides[0].cost - 2 * middle.cost + sides[1].cost) / (step * step);
    if (!(curvature > 0) || !std::isfinite(curvature)) return {};
    const double change = 0.5 * (sides[0].cost - sides[1].cost) / (curvature * step);
    k1 += change;
    if (!(std::abs(k1) < kMaxK1)) return {};
    Trial next = search.trial(k1, middle.scene);
    // The same displacement of a pixel, told by the new focal lengths.
    const double ratio = mean_square_ratio(tracks, weights, middle.scene.lenses, next.scene.lenses);
    middle = std::move(next);
    k1 *= ratio, curvature /= ratio * ratio;
    if (std::abs(change) > 0.5 * step) continue;  // beyond where the parabola was measured
    if (step == kStep) break;
    step = kStep;
  }
  RadialEstimate estimate;
  estimate.k1 = k1;
  // Twice the cost over the degrees of freedom, of which the observations are nearly all.
  const double variance = 2 * middle.cost / std::max(1, 2 * middle.summary.used);
  estimate.sigma = std::sqrt(variance / curvature);
  estimate.gain = 2 * (without - middle.cost) / variance;
  for (size_t j = 0; j < scene.lenses.size(); ++j) {
    estimate.lens_by_k1.push_back((sides[1].scene.lenses[j].vector() - sides[0].scene.lenses[j].vector()) /
                                  (2 * step));
  }
  estimate.scene = std::move(middle.scene);
  return estimate;
}

}  // namespace raysfm
