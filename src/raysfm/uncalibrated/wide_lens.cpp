#include "raysfm/uncalibrated/wide_lens.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "raysfm/scene/frame_lens.h"

namespace raysfm {
namespace {

// Part of its distance from the centre at which a corner of the image is seen, to that without distortion;
// and the angle at which it is seen, degrees.
constexpr double kBent = 0.9, kWideCorner = 52;
// Angles that the width of the image is guessed to span, degrees: of a fisheye whose circle lies within the
// image more than there is.
constexpr double kGuesses[] = {140, 105, 190, 250};
constexpr double kEnoughPosed = 0.9;  // images, of those that a perspective lens poses
constexpr double kEnoughCommon =
    0.3;                             // observations that both explain, of those that a perspective lens does
constexpr double kSureRatio = 1.15;  // of the rms
constexpr int kMoreNumbers = 2;      // k1 to k4 in the place of k1, k2

std::vector<Camera> guesses(const Eigen::Vector2d& size) {
  std::vector<Camera> cameras;
  for (const double degrees : kGuesses) {
    const double focal = size.x() / (degrees * std::numbers::pi / 180);
    Camera& camera = cameras.emplace_back();
    camera.width = static_cast<int>(size.x());
    camera.height = static_cast<int>(size.y());
    camera.model = KannalaBrandt{focal, focal, 0.5 * (size.x() - 1), 0.5 * (size.y() - 1)};
  }
  return cameras;
}

int posed_images(const UncalibratedReconstruction& r) {
  return static_cast<int>(std::ranges::count(r.image_posed, 1));
}

// The first that reaches enough images, else the one that reaches most.
RayReconstruction best_guess(const PointTracks& tracks, const SolveOptions& options, int enough,
                             int threads) {
  RayOptions along_rays{.max_error_px = options.max_error_px, .seed = options.seed, .threads = threads};
  along_rays.stopped = [&options] { return options.stopped(); };
  if (options.principal_point_sigma > 0) along_rays.centre_sigma = options.principal_point_sigma;
  RayReconstruction best;
  for (const Camera& guess : guesses(tracks.image_size)) {
    if (best.posed >= enough || options.stopped()) break;
    RayReconstruction r = reconstruct_along_rays(tracks, guess, along_rays);
    if (r.posed > best.posed) best = std::move(r);
  }
  return best;
}

// Sums of squared errors over the observations of points that both place in images that both pose and that
// either explains, each at most that of the largest error allowed.
struct Errors {
  double perspective = 0, along_rays = 0;
  int observations = 0;
};

Errors compare(const PointTracks& tracks, const UncalibratedReconstruction& perspective,
               const RayReconstruction& along_rays, double max_error) {
  Errors errors;
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = tracks.image[k], point = tracks.point[k];
    Eigen::Vector2d residual;
    if (!(perspective.inlier[k] || along_rays.inlier[k]) || !perspective.image_posed[image] ||
        !perspective.point_placed[point] || !along_rays.image_posed[image] || !along_rays.point_placed[point])
      continue;
    const double most = max_error * max_error;
    const bool is_seen = along_rays.inlier[k] && pixel_residual(tracks, along_rays, k, &residual);
    errors.along_rays += is_seen ? residual.squaredNorm() : most;
    errors.perspective += perspective.inlier[k]
                              ? pixel_residual(tracks, perspective.scene, perspective.radial, k).squaredNorm()
                              : most;
    ++errors.observations;
  }
  return errors;
}

}  // namespace

bool may_be_wide_lens(const PointTracks& tracks, const UncalibratedReconstruction& perspective) {
  const auto image = std::ranges::find(perspective.image_posed, 1) - perspective.image_posed.begin();
  if (perspective.zooming || image == std::ssize(perspective.image_posed)) return false;
  Lens lens = perspective.scene.lenses[image];
  lens.cx = lens.cy = 0;
  const Camera camera = frame_lens(lens, perspective.radial).camera;
  const Eigen::Vector2d corner = 0.5 * tracks.image_size;
  Ray ray;
  if (!camera.ray(corner, &ray)) return true;
  const double tangent = ray.direction.hnormalized().norm();
  const double bent = corner.cwiseQuotient(Eigen::Vector2d(lens.fx, lens.fy)).norm() / tangent;
  return bent < kBent || std::atan(tangent) > kWideCorner * std::numbers::pi / 180;
}

WideLensSearch find_wide_lens(const PointTracks& tracks, const SolveOptions& options,
                              const UncalibratedReconstruction& perspective, int threads) {
  WideLensSearch search;
  const int posed = posed_images(perspective);
  RayReconstruction r =
      best_guess(tracks, options, static_cast<int>(std::ceil(kEnoughPosed * posed)), threads);
  if (r.posed < kEnoughPosed * posed || !std::isfinite(r.sigma.focal)) return search;
  const Errors errors = compare(tracks, perspective, r, options.max_error_px);
  const auto explained = static_cast<double>(std::ranges::count(perspective.inlier, 1));
  if (errors.observations < kEnoughCommon * explained) return search;
  search.compared = true;
  const double variance = errors.along_rays / std::max(1, 2 * errors.observations);
  const double gain = (errors.perspective - errors.along_rays) / std::max(variance, 1e-12);
  const double needed = kMoreNumbers * std::log(std::max(2, 2 * errors.observations));
  const double ratio = std::sqrt(errors.perspective / std::max(errors.along_rays, 1e-12));
  const auto rms = [&](double sum) { return std::sqrt(sum / std::max(1, errors.observations)); };
  search.evidence = fmt::format("rms {:.2f} px with a perspective lens, {:.2f} px with a {} one",
                                rms(errors.perspective), rms(errors.along_rays), model_name(r.camera.model));
  if (gain > needed && ratio > kSureRatio) search.found = std::move(r);
  return search;
}

}  // namespace raysfm
