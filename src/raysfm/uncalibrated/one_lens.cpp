#include "raysfm/uncalibrated/one_lens.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "raysfm/uncalibrated/lens_choice.h"

namespace raysfm {
namespace {

// Degrees of freedom of Student's distribution; with twice as many the focal lengths of three real videos are
// others by 0.3 % at most.
constexpr double kTails = 2;
constexpr int kReweightings = 6;
// Where the width changes by a smaller part, the weights have settled.
constexpr double kSettledWidth = 1e-3;
constexpr double kLeastWidth = 1e-4;  // pixels
// Decrease of the cost, as a part of it, that ends an adjustment: of any, and of the last by Student's
// weights.
constexpr double kEnough = 1e-3, kEnoughAtLast = 1e-5;
constexpr int kRadialTerms = 2;  // k1, k2

struct TrackResiduals {
  std::vector<double> square;  // sums over the observations of a point
  std::vector<int> count;      // observations of a point
  int images = 0;              // with observations
};

TrackResiduals residuals_by_track(const PointTracks& tracks, std::span<const uint8_t> used,
                                  const UncalibratedScene& scene, const RadialDistortion& radial) {
  TrackResiduals r;
  r.square.assign(tracks.point_count, 0);
  r.count.assign(tracks.point_count, 0);
  std::vector<uint8_t> seen(tracks.image_count, 0);
  for (int k = 0; k < tracks.size(); ++k) {
    if (!used[k]) continue;
    r.square[tracks.point[k]] += pixel_residual(tracks, scene, radial, k).squaredNorm();
    ++r.count[tracks.point[k]];
    seen[tracks.image[k]] = 1;
  }
  r.images = static_cast<int>(std::ranges::count(seen, 1));
  return r;
}

// What the observations of a point say beyond where it is.
int freedom_of_track(const TrackResiduals& r, int point) {
  return std::max(1, 2 * r.count[point] - 3);
}

double weight_of_track(const TrackResiduals& r, int point, double width) {
  const int d = freedom_of_track(r, point);
  return (kTails + d) / (kTails + r.square[point] / (width * width));
}

// The width of the distribution, pixels: the likeliest, found by expectation and maximisation.
double fitted_width(const TrackResiduals& r) {
  constexpr int kIterations = 50;
  constexpr double kStart = 0.3, kEnough = 1e-6;
  double width = kStart;
  for (int i = 0; i < kIterations; ++i) {
    double sum = 0, all = -6.0 * r.images;
    for (size_t p = 0; p < r.count.size(); ++p) {
      if (r.count[p] < 2) continue;
      sum += weight_of_track(r, static_cast<int>(p), width) * r.square[p];
      all += freedom_of_track(r, static_cast<int>(p));
    }
    const double next = std::max(kLeastWidth, std::sqrt(sum / std::max(1.0, all)));
    const bool done = std::abs(next - width) < kEnough * width;
    width = next;
    if (done) break;
  }
  return width;
}

// The image in which a point is seen first, -1 for one that is not.
std::vector<int> first_images(const PointTracks& tracks, std::span<const uint8_t> used) {
  std::vector<int> birth(tracks.point_count, -1);
  for (int k = 0; k < tracks.size(); ++k) {
    int& first = birth[tracks.point[k]];
    if (used[k] && (first < 0 || tracks.image[k] < first)) first = tracks.image[k];
  }
  return birth;
}

// Standard deviations by the influences of tracks, or of those with one birth.
LensNumbers scatter_of_groups(const PointTracks& tracks, std::span<const uint8_t> used,
                              const Eigen::Matrix<double, 7, Eigen::Dynamic>& influence) {
  if (influence.cols() == 0) return LensNumbers::Constant(std::numeric_limits<double>::infinity());
  Eigen::Matrix<double, 7, Eigen::Dynamic> by_birth =
      Eigen::Matrix<double, 7, Eigen::Dynamic>::Zero(7, tracks.image_count);
  const std::vector<int> birth = first_images(tracks, used);
  for (int i = 0; i < tracks.point_count; ++i) {
    if (birth[i] >= 0) by_birth.col(birth[i]) += influence.col(i);
  }
  return influence.rowwise().squaredNorm().cwiseMax(by_birth.rowwise().squaredNorm()).cwiseSqrt();
}

// The influences are those for weights that stay. But they fall as a residual grows: the slope of the
// weighted residuals, on the average, is so many times less than the weights (Huber, Robust Statistics, 7.6).
double slope_correction(const TrackResiduals& r, double width) {
  double weights = 0, slopes = 0;
  for (int p = 0; p < static_cast<int>(r.count.size()); ++p) {
    if (r.count[p] < 2) continue;
    const double w = weight_of_track(r, p, width), square = r.square[p] / (width * width);
    weights += w * freedom_of_track(r, p);
    slopes += w * (freedom_of_track(r, p) - 2 * square / (kTails + square));
  }
  return slopes > 0 ? weights / slopes : 1;
}

// Whether a number is there: surer than noise, and of an effect that can be seen at the corners of the image.
bool is_told(double number, double sigma, double effect_px) {
  constexpr double kSigmas = 3, kLeastEffect = 0.1;
  return std::abs(number) > kSigmas * sigma && std::abs(effect_px) > kLeastEffect;
}

LensAdjustmentOptions adjustment_from_near(const PointTracks& tracks, const SolveOptions& options,
                                           int radial_terms) {
  LensAdjustmentOptions adjustment;
  adjustment.constraints = constraints_for(tracks, options, true);
  adjustment.radial_terms = radial_terms;
  adjustment.with_sigma = false;
  adjustment.threads = options.threads;
  adjustment.lm.initial_damping = 1e-6;
  adjustment.lm.max_iterations = 10;
  adjustment.lm.min_relative_decrease = kEnough;
  adjustment.lm.progress = &options.go_on;
  return adjustment;
}

RadialDistortion first_terms(const RadialDistortion& radial, int terms) {
  return {terms > 0 ? radial.k1 : 0, terms > 1 ? radial.k2 : 0};
}

LensNumbers numbers_of(const UncalibratedScene& scene, const RadialDistortion& radial) {
  LensNumbers numbers;
  numbers << scene.lenses.front().vector(), radial.k1, radial.k2;
  return numbers;
}

}  // namespace

Result<OneLens> adjust_one_lens(const PointTracks& tracks, std::span<const uint8_t> used,
                                const SolveOptions& options, int radial_terms, const UncalibratedScene& start,
                                const RadialDistortion& radial) {
  OneLens result{.scene = start, .radial = radial, .adjustment = {}};
  result.terms = radial_terms;
  LensAdjustmentOptions adjustment = adjustment_from_near(tracks, options, radial_terms);
  std::vector<double> weights(tracks.size());
  int iterations = 0;
  double correction = 1, last_width = 0;
  bool last = false;
  for (int i = 0; !last; ++i) {
    const TrackResiduals r = residuals_by_track(tracks, used, result.scene, result.radial);
    const double width = fitted_width(r);
    last = i + 1 == kReweightings || std::abs(width - last_width) < kSettledWidth * width;
    last_width = width;
    correction = slope_correction(r, width);
    for (int k = 0; k < tracks.size(); ++k)
      weights[k] = used[k] ? weight_of_track(r, tracks.point[k], width) : 0;
    adjustment.constraints = constraints_for(tracks, options, true, width);
    adjustment.radial = first_terms(result.radial, radial_terms);
    adjustment.with_influence = last;
    if (last) adjustment.lm.min_relative_decrease = kEnoughAtLast;
    auto summary = adjust_standard(tracks, weights, adjustment, &result.scene);
    if (!summary) return summary.error();
    result.radial = summary->radial;
    iterations += summary->lm.iterations;
    result.adjustment = std::move(*summary);
    if (options.stopped()) break;
  }
  result.adjustment.lm.iterations = iterations;
  result.sigma = correction * scatter_of_groups(tracks, used, result.adjustment.influence);
  return result;
}

Result<void> widen_by_other_weights(const PointTracks& tracks, std::span<const uint8_t> used,
                                    const SolveOptions& options, OneLens* lens) {
  LensAdjustmentOptions adjustment = adjustment_from_near(tracks, options, lens->terms);
  adjustment.loss = {RobustLoss::Kind::kHuber, options.max_error_px / 3};
  adjustment.radial = lens->radial;
  UncalibratedScene scene = lens->scene;
  const std::vector<double> weights(used.begin(), used.end());
  const auto summary = adjust_standard(tracks, weights, adjustment, &scene);
  if (!summary) return summary.error();
  const LensNumbers change = numbers_of(scene, summary->radial) - numbers_of(lens->scene, lens->radial);
  for (int i = 0; i < change.size(); ++i) lens->sigma[i] = std::hypot(lens->sigma[i], change[i]);
  return {};
}

Result<OneLens> adjust_one_lens_widened(const PointTracks& tracks, std::span<const uint8_t> used,
                                        const SolveOptions& options, int radial_terms,
                                        const UncalibratedScene& start, const RadialDistortion& radial) {
  auto lens = adjust_one_lens(tracks, used, options, radial_terms, start, radial);
  if (!lens) return lens;
  if (auto r = widen_by_other_weights(tracks, used, options, &*lens); !r) return r.error();
  return lens;
}

Result<OneLens> adjust_one_lens_as_told(const PointTracks& tracks, std::span<const uint8_t> used,
                                        const SolveOptions& options, const UncalibratedScene& start,
                                        const RadialDistortion& radial) {
  auto free = adjust_one_lens_widened(tracks, used, options, kRadialTerms, start, radial);
  const double corner = 0.5 * tracks.image_size.norm();
  for (int terms = kRadialTerms; free && terms > 0; --terms) {
    const double focal = free->scene.lenses.front().fx;
    const double last = terms == 2 ? free->radial.k2 : free->radial.k1;
    const double effect = last * focal * std::pow(corner / focal, 2 * terms + 1);
    if (is_told(last, free->sigma[4 + terms], effect)) return free;
    auto fewer = adjust_one_lens_widened(tracks, used, options, terms - 1, free->scene, free->radial);
    if (!fewer) return free;
    if (terms == 1) {
      const LensNumbers change = numbers_of(free->scene, free->radial) - numbers_of(fewer->scene, {});
      for (int i = 0; i < 5; ++i) fewer->sigma[i] = std::hypot(fewer->sigma[i], change[i]);
    }
    free = std::move(fewer);
  }
  return free;
}

Result<OneLens> adjust_one_lens_to_the_end(const PointTracks& tracks, std::span<const uint8_t> used,
                                           const SolveOptions& options, const UncalibratedScene& start,
                                           const RadialDistortion& radial) {
  if (options.radial == RadialChoice::kIfSure) {
    return adjust_one_lens_as_told(tracks, used, options, start, radial);
  }
  const int terms = options.radial == RadialChoice::kFree ? kRadialTerms : 0;
  return adjust_one_lens_widened(tracks, used, options, terms, start, radial);
}

void add_model_error(UncalibratedReconstruction* result) {
  constexpr double kModelError = 0.005;
  for (size_t j = 0; j < result->lens_sigma.size(); ++j) {
    for (const int focal : {0, 1}) {
      double& sigma = result->lens_sigma[j][focal];
      sigma = std::hypot(sigma, kModelError * result->scene.lenses[j].vector()[focal]);
    }
  }
}

bool adjusts_one_lens(const SolveOptions& options, const UncalibratedReconstruction& result) {
  return !result.zooming && options.method != LensMethod::kIntrinsicsFree;
}

void take_lens(const PointTracks& tracks, std::span<const uint8_t> judged, const SolveOptions& options,
               OneLens lens, UncalibratedReconstruction* result) {
  result->scene = std::move(lens.scene);
  result->radial = lens.radial;
  result->radial_sigma = {lens.radial.k1 != 0 ? lens.sigma[5] : 0, lens.radial.k2 != 0 ? lens.sigma[6] : 0};
  result->lens_sigma.assign(tracks.image_count, lens.sigma.head<5>());
  result->adjustment = std::move(lens.adjustment);
  std::vector<int> good(tracks.point_count, 0), seen(tracks.point_count, 0);
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = tracks.image[k], point = tracks.point[k];
    result->inlier[k] = 0;
    if (!judged[image] || !result->image_posed[image]) continue;
    ++seen[point];
    if (!result->point_placed[point]) continue;
    result->inlier[k] =
        pixel_residual(tracks, result->scene, result->radial, k).norm() < options.max_error_px;
    good[point] += result->inlier[k];
  }
  for (int i = 0; i < tracks.point_count; ++i) {
    result->point_placed[i] = good[i] >= 2 && 2 * good[i] > seen[i];
  }
  for (int k = 0; k < tracks.size(); ++k) result->inlier[k] &= result->point_placed[tracks.point[k]];
  result->rms_px = rms_error(tracks, result->scene, result->radial, result->inlier);
}

}  // namespace raysfm
