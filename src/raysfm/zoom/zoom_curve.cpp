#include "raysfm/zoom/zoom_curve.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/zoom/map_stretch.h"

namespace raysfm {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMostEnlarged = 2;
// Key frames that are adjusted together, from one such stretch to the next, and at least.
constexpr size_t kTogether = 100, kToNext = 50, kLeastTogether = 5;
constexpr size_t kMostFollowed = 3000;  // points of a stretch
// Rough focal lengths that are none: farther from the usual one than cameras zoom, and from those of the
// frames around; logarithms.
constexpr double kAbsurd = 1.4, kApart = 0.1;
constexpr int kAround = 7;  // frames to either side
// A jump: by so much of log f between two frames, and by so many times what both sides scatter.
constexpr double kSudden = 0.02, kClear = 5;
constexpr double kLeastSigma = 1e-4;  // of log f
// How much the slope of log f changes from frame to frame, and the common error of rough values. A zoom by
// two in one second at 30 frames a second: 5e-3.
constexpr std::array kAccelerations = {1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2};
constexpr std::array kWanders = {1e-5, 1e-4, 3e-4, 1e-3, 3e-3};
// Of a standard deviation that was measured: what is not common to all frames.
constexpr std::array kOwnParts = {0.03, 0.1, 0.3, 1.0};

struct Line {
  double value = 0;  // where it is asked for
  double rms = kInfinity;
};

// The line through those of values[first ... last] that are numbers, at `at`.
Line line_through(std::span<const double> values, int first, int last, int at) {
  first = std::max(first, 0), last = std::min(last, static_cast<int>(values.size()) - 1);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (int i = first; i <= last; ++i) {
    const double u = i - at, v = values[i];
    if (std::isnan(v)) continue;
    n += 1, x += u, y += v, xx += u * u, xy += u * v, yy += v * v;
  }
  if (n < 4) return {};
  x /= n, y /= n;
  const double slope = (xy - n * x * y) / (xx - n * x * x);
  const double square = yy - n * y * y - slope * (xy - n * x * y);
  return {y - slope * x, std::sqrt(std::max(0.0, square) / (n - 2))};
}

double median_around(std::span<const double> values, int at, int around) {
  std::vector<double> some;
  const int last = std::min(static_cast<int>(values.size()) - 1, at + around);
  for (int i = std::max(0, at - around); i <= last; ++i) {
    if (!std::isnan(values[i])) some.push_back(values[i]);
  }
  return median_of(&some);
}

void leave_out_absurd(std::vector<double>* values) {
  const int count = static_cast<int>(values->size());
  const double usual = median_around(*values, 0, count);
  for (double& v : *values) {
    if (!(std::abs(v - usual) < kAbsurd)) v = NAN;
  }
  const std::vector<double> all = *values;
  for (int i = 0; i < count; ++i) {
    if (!(std::abs(all[i] - median_around(all, i, kAround)) < kApart)) (*values)[i] = NAN;
  }
}

// By how much the value at a frame is beside the line of those before it, and whether that is a jump.
double jump_at(std::span<const double> values, int at) {
  const Line before = line_through(values, at - kAround - 1, at - 1, at);
  const Line after = line_through(values, at, at + kAround, at);
  const double gap = std::abs(after.value - before.value);
  const bool is_clear = gap > kSudden && gap > kClear * (before.rms + after.rms);
  return is_clear ? gap : 0;
}

// Value, slope and common error of the rough values along the frames.
class CurveFilter {
 public:
  struct Seen {
    std::span<const double> rough, sigma;  // by frame
    const std::vector<bool>& jumps;
    std::span<const FocalMeasurement> measured;
  };
  CurveFilter() = default;
  CurveFilter(const Seen& seen, double acceleration, double wander, double own_part) : log_likelihood_(0) {
    noise_.topLeftCorner<2, 2>() << 1.0 / 3, 0.5, 0.5, 1;
    noise_ *= acceleration * acceleration;
    noise_(2, 2) = wander * wander;
    State state = first_state(seen);
    auto next = seen.measured.begin();
    for (size_t f = 0; f < seen.rough.size(); ++f) {
      if (f > 0) state = advanced(state, seen.jumps[f]);
      predicted_.push_back(state);
      if (std::isfinite(seen.sigma[f])) measure({1, 0, 1}, seen.rough[f], seen.sigma[f], &state);
      for (; next != seen.measured.end() && next->frame == static_cast<int>(f); ++next)
        measure({1, 0, 0}, next->log_focal, own_part * next->sigma, &state);
      filtered_.push_back(state);
    }
  }

  double log_likelihood() const { return log_likelihood_; }

  // By what comes after, too (Rauch, Tung and Striebel).
  std::vector<double> smoothed() const {
    std::vector<double> values(filtered_.size());
    State after = filtered_.back();
    values.back() = after.mean[0];
    for (size_t f = filtered_.size() - 1; f-- > 0;) {
      const Eigen::Matrix3d gain =
          filtered_[f].covariance * step().transpose() * predicted_[f + 1].covariance.inverse();
      after.mean = filtered_[f].mean + gain * (after.mean - predicted_[f + 1].mean);
      values[f] = after.mean[0];
    }
    return values;
  }

 private:
  struct State {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  };

  // The common error is nothing where nothing tells it.
  static State first_state(const Seen& seen) {
    constexpr double kValue = 1, kSlope = 0.1, kCommon = 0.3, kNone = 1e-9;
    const double common = seen.measured.empty() ? kNone : kCommon;
    State state;
    const auto first = std::ranges::find_if(seen.sigma, [](double s) { return std::isfinite(s); });
    if (first != seen.sigma.end()) state.mean[0] = seen.rough[first - seen.sigma.begin()];
    state.covariance.diagonal() << kValue * kValue, kSlope * kSlope, common * common;
    return state;
  }
  static Eigen::Matrix3d step() {
    Eigen::Matrix3d step = Eigen::Matrix3d::Identity();
    step(0, 1) = 1;
    return step;
  }
  State advanced(const State& s, bool jumps) const {
    State next{step() * s.mean, step() * s.covariance * step().transpose() + noise_};
    if (jumps) next.covariance(0, 0) += 1;
    return next;
  }
  void measure(const Eigen::RowVector3d& of, double value, double sigma, State* s) {
    const double variance = of * s->covariance * of.transpose() + sigma * sigma;
    const double innovation = value - of * s->mean;
    const Eigen::Vector3d gain = s->covariance * of.transpose() / variance;
    s->mean += gain * innovation;
    s->covariance -= (gain * of * s->covariance).eval();
    log_likelihood_ -= 0.5 * (innovation * innovation / variance + std::log(variance));
  }

  double log_likelihood_ = -kInfinity;
  Eigen::Matrix3d noise_ = Eigen::Matrix3d::Zero();
  std::vector<State> predicted_, filtered_;
};

// A value at some of the frames, and how much it counts.
struct Sum {
  double value = 0, sigma = 0, weight = 0;
};

// Adds what a stretch of key frames says, least where it ends.
void add_stretch(const Reconstruction& r, const Lens& lens, std::span<const KeyFrame> keyframes,
                 std::vector<Sum>* sums) {
  MapStretch s = stretch_of(r, lens, keyframes, kMostFollowed);
  LensAdjustmentOptions options;
  options.constraints.known_principal_point = true;
  options.constraints.principal_point = {lens.cx, lens.cy};
  options.loss = {RobustLoss::Kind::kCauchy, 1};
  const auto adjusted = adjust_standard(s.tracks, {}, options, &s.found.scene);
  if (!adjusted) return;
  for (size_t k = 0; k < keyframes.size(); ++k) {
    const double focal = s.found.scene.lenses[k].fx, sigma = adjusted->lens_sigma[k][0];
    if (!(focal > 0) || !std::isfinite(focal) || !std::isfinite(sigma)) continue;
    Sum& sum = (*sums)[keyframes[k].frame];
    const auto weight = static_cast<double>(std::min(k + 1, keyframes.size() - k));
    sum.value += weight * std::log(focal);
    sum.sigma += weight * sigma / focal;
    sum.weight += weight;
  }
}

}  // namespace

ZoomCurve::ZoomCurve(int frames, std::span<const FocalMeasurement> rough)
    : rough_(frames, NAN), sigma_(frames, kInfinity), jumps_(frames, false) {
  std::vector<double> values;
  for (const FocalMeasurement& m : rough) values.push_back(m.log_focal);
  leave_out_absurd(&values);
  const int count = static_cast<int>(values.size());
  std::vector<double> gaps(count, 0);
  for (int i = 1; i < count; ++i) gaps[i] = jump_at(values, i);
  for (int i = 0; i < count; ++i) {
    const int first = std::max(0, i - kAround), last = std::min(count - 1, i + kAround);
    const double widest = *std::max_element(gaps.begin() + first, gaps.begin() + last + 1);
    jumps_[rough[i].frame] = gaps[i] > 0 && gaps[i] == widest;
    if (std::isnan(values[i])) continue;
    double scatter = kInfinity;
    for (const int from : {i - kAround, i - kAround / 2, i})
      scatter = std::min(scatter, line_through(values, from, from + kAround, i).rms);
    rough_[rough[i].frame] = values[i];
    sigma_[rough[i].frame] = std::max(kLeastSigma, scatter);
  }
}

std::vector<double> ZoomCurve::log_focals(std::span<const FocalMeasurement> measured) const {
  const CurveFilter::Seen seen{rough_, sigma_, jumps_, measured};
  CurveFilter best;
  for (const double acceleration : kAccelerations) {
    for (const double wander : kWanders) {
      for (const double own_part : kOwnParts) {
        CurveFilter filter(seen, acceleration, wander, own_part);
        if (filter.log_likelihood() > best.log_likelihood()) best = std::move(filter);
      }
    }
  }
  return best.smoothed();
}

std::vector<FocalMeasurement> focals_of(const Reconstruction& solved) {
  std::vector<FocalMeasurement> focals;
  for (size_t f = 0; f < solved.frames.size(); ++f) {
    const int lens = solved.frames[f].lens;
    if (lens >= 0) focals.push_back({static_cast<int>(f), std::log(lens_of(solved.lenses[lens])->fx), 0});
  }
  return focals;
}

UndoneZoom undo_zoom(std::span<const double> log_focals, int width, int height) {
  UndoneZoom zoom;
  for (const double log_focal : log_focals) zoom.focals.push_back(std::exp(log_focal));
  const auto [least, most] = std::ranges::minmax(zoom.focals);
  zoom.focal = std::min(most, kMostEnlarged * least);
  zoom.width = static_cast<int>(std::ceil(width * zoom.focal / least));
  zoom.height = static_cast<int>(std::ceil(height * zoom.focal / least));
  return zoom;
}

std::vector<FocalMeasurement> measure_focals(const Reconstruction& tracked, const UndoneZoom& zoom) {
  std::optional<Lens> lens = lens_of(tracked.rig.cameras[0]);
  if (!lens) return {};
  lens->fy = lens->fx;  // rays in square pixels
  std::vector<Sum> sums(tracked.frames.size());
  for (const std::vector<KeyFrame>& keyframes : keyframes_by_world(tracked)) {
    size_t first = 0;
    while (first + kLeastTogether <= keyframes.size()) {
      const size_t count = std::min(kTogether, keyframes.size() - first);
      add_stretch(tracked, *lens, std::span(keyframes).subspan(first, count), &sums);
      if (first + count == keyframes.size()) break;
      first += kToNext;
    }
  }
  std::vector<FocalMeasurement> measured;
  for (size_t f = 0; f < sums.size(); ++f) {
    const Sum& sum = sums[f];
    if (sum.weight == 0) continue;
    measured.push_back({static_cast<int>(f), sum.value / sum.weight - std::log(zoom.place(f).scale),
                        std::max(kLeastSigma, sum.sigma / sum.weight)});
  }
  return measured;
}

}  // namespace raysfm
