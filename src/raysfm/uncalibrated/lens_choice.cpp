#include "raysfm/uncalibrated/lens_choice.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

// Of the observations in compared images that either reconstruction explains.
struct Comparison {
  double fixed = 0, zoom = 0;             // sums of squared errors, each at most the largest allowed
  std::vector<double> of_fixed, of_zoom;  // the same by image
  int observations = 0, images = 0, points = 0;
};

double truncated_square(const PointTracks& tracks, const UncalibratedReconstruction& r, int k,
                        double max_error) {
  if (!r.inlier[k]) return max_error * max_error;
  return pixel_residual(tracks, r.scene, r.radial, k).squaredNorm();
}

Comparison compare(const PointTracks& tracks, std::span<const uint8_t> compared,
                   const UncalibratedReconstruction& fixed, const UncalibratedReconstruction& zoom,
                   double max_error) {
  Comparison c;
  c.of_fixed.assign(tracks.image_count, 0);
  c.of_zoom.assign(tracks.image_count, 0);
  // What only one reached says nothing of the lens.
  const auto posed = [&](int j) { return compared[j] && fixed.image_posed[j] && zoom.image_posed[j]; };
  const auto placed = [&](int i) { return fixed.point_placed[i] && zoom.point_placed[i]; };
  for (int k = 0; k < tracks.size(); ++k) {
    if (!(fixed.inlier[k] || zoom.inlier[k]) || !posed(tracks.image[k]) || !placed(tracks.point[k])) continue;
    const double by_fixed = truncated_square(tracks, fixed, k, max_error);
    const double by_zoom = truncated_square(tracks, zoom, k, max_error);
    c.fixed += by_fixed;
    c.zoom += by_zoom;
    c.of_fixed[tracks.image[k]] += by_fixed;
    c.of_zoom[tracks.image[k]] += by_zoom;
    ++c.observations;
  }
  for (int j = 0; j < tracks.image_count; ++j) c.images += posed(j);
  for (int i = 0; i < tracks.point_count; ++i) c.points += placed(i);
  return c;
}

// Standard deviation of the logarithm of the focal length over the compared images.
double focal_spread(std::span<const uint8_t> compared, const UncalibratedReconstruction& r) {
  double sum = 0, square = 0, count = 0;
  for (size_t j = 0; j < compared.size(); ++j) {
    if (!compared[j] || !r.image_posed[j]) continue;
    const double log_focal = std::log(r.scene.lenses[j].fx);
    sum += log_focal, square += log_focal * log_focal, ++count;
  }
  return count > 0 ? std::sqrt(std::max(0.0, square / count - std::pow(sum / count, 2))) : 0;
}

// How far, in the root mean square, the logarithm of the focal length is from the usual one (the median) in
// the images that a lens of their own explains better, by how much it does. Where the camera goes the way it
// looks, or sees a plane, a lens for each image may be any, and nothing gains by it: a film with a turn on
// the spot changed by 10 % in images that gained nothing, by 1.6 in those that did. Those that gain may all
// have one focal length, where one lens for all is that of the others.
double spread_where_it_gains(const Comparison& c, std::span<const uint8_t> compared,
                             const UncalibratedReconstruction& zoom) {
  std::vector<double> logs;
  for (size_t j = 0; j < compared.size(); ++j) {
    if (compared[j] && zoom.image_posed[j]) logs.push_back(std::log(zoom.scene.lenses[j].fx));
  }
  if (logs.empty()) return 0;
  const double usual = median_of(&logs);
  double square = 0, all = 0;
  for (size_t j = 0; j < compared.size(); ++j) {
    const double gain = c.of_fixed[j] - c.of_zoom[j];
    if (!(gain > 0)) continue;
    square += gain * std::pow(std::log(zoom.scene.lenses[j].fx) - usual, 2), all += gain;
  }
  return all > 0 ? std::sqrt(square / all) : 0;
}

// How many times the rms of the image in the middle is with one lens what it is with a lens of its own. A few
// images in wrong places have lenses of their own too, where there is but one: there it is 1.00 to 1.11.
// Where every second photo zooms by 1.02 it is 1.57, where one of eleven does by 1.3 it is 1.21,
// by 1.05 1.06.
double usual_ratio(const Comparison& c) {
  std::vector<double> ratios;
  for (size_t j = 0; j < c.of_fixed.size(); ++j) {
    if (c.of_zoom[j] > 0) ratios.push_back(std::sqrt(c.of_fixed[j] / c.of_zoom[j]));
  }
  return ratios.empty() ? 1 : median_of(&ratios);
}

// Observations less the numbers of the poses, the lenses and, where they are not given, the points.
double freedom(const Comparison& c, bool points_are_given) {
  const double of_points = points_are_given ? 0.0 : 3.0 * c.points - 7;
  return std::max(1.0, 2.0 * c.observations - 9.0 * c.images - of_points);
}

struct Verdict {
  bool zooming;
  double gain, spread;
  std::string evidence;
};

Verdict judge_lens(const Comparison& c, double freedom, double spread, ErrorRelation errors) {
  constexpr double kLeastSpread = 0.01, kSureSpread = 0.03, kSureRatio = 1.15, kPhotoRatio = 1.143;
  const bool along_tracks = errors == ErrorRelation::kAlongTracks;
  const double gain = (c.fixed - c.zoom) / std::max(c.zoom / freedom, 1e-12);
  const double added = 3.0 * std::max(1, c.images - 1);
  const double needed =
      along_tracks ? added * std::log(std::max(2, 2 * c.observations)) : added + 4 * std::sqrt(2 * added);
  const double ratio = std::sqrt(c.fixed / std::max(c.zoom, 1e-12));
  const double usual = usual_ratio(c);
  const bool is_in_most = along_tracks || usual > kPhotoRatio;
  const bool changes = spread > kLeastSpread && is_in_most && (spread > kSureSpread || ratio > kSureRatio);
  const auto rms = [&](double cost) { return std::sqrt(cost / std::max(1, c.observations)); };
  std::string evidence = fmt::format(
      "rms {:.3f} px with one lens, {:.3f} px with one for each image over the same observations: {:.0f} "
      "variances less, more than {:.0f} mean zooming",
      rms(c.fixed), rms(c.zoom), gain, needed);
  if (errors != ErrorRelation::kNone) {
    evidence +=
        fmt::format(" where {} by more than 3 % in focal length{}, or by 1 % and the rms falls by a seventh",
                    along_tracks ? "those images change" : "photos change",
                    along_tracks ? " that gain by it" : " and the rms of most of them falls by an eighth");
  }
  if (errors != ErrorRelation::kNone) evidence += fmt::format("; it changes by {:.2f} %", 100 * spread);
  if (errors == ErrorRelation::kWithinImages)
    evidence += fmt::format(", and the rms of the photo in the middle falls by {:.1f} %", 100 - 100 / usual);
  return {gain > needed && (changes || errors == ErrorRelation::kNone), ratio, spread, std::move(evidence)};
}

}  // namespace

Result<UncalibratedReconstruction> choose_lens(const PointTracks& tracks, std::span<const uint8_t> compared,
                                               Result<UncalibratedReconstruction> fixed,
                                               Result<UncalibratedReconstruction> zoom, double max_error_px,
                                               ErrorRelation errors) {
  if (!fixed && !zoom) return fixed;
  Verdict verdict{!fixed, 0, 0,
                  std::string("no solution with ") + (fixed ? "a lens for each image" : "one lens")};
  if (fixed && zoom) {
    const Comparison c = compare(tracks, compared, *fixed, *zoom, max_error_px);
    const double spread = errors == ErrorRelation::kAlongTracks ? spread_where_it_gains(c, compared, *zoom)
                                                                : focal_spread(compared, *zoom);
    verdict = judge_lens(c, freedom(c, zoom->world_is_given), spread, errors);
  }
  auto& chosen = verdict.zooming ? zoom : fixed;
  chosen->lens_gain = verdict.gain;
  chosen->lens_spread = verdict.spread;
  chosen->lens_evidence = std::move(verdict.evidence);
  return std::move(chosen);
}

double rms_error(const PointTracks& tracks, const UncalibratedScene& scene, const RadialDistortion& radial,
                 std::span<const uint8_t> marked) {
  double sum = 0;
  int count = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    if (!marked[k]) continue;
    sum += pixel_residual(tracks, scene, radial, k).squaredNorm();
    ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

}  // namespace raysfm
