#include "raysfm/ray_lenses/wide_lens.h"

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
// Angles that the longer side of the image is guessed to span, degrees: of a fisheye whose circle lies within
// the image more than there is.
constexpr double kGuesses[] = {140, 105, 190, 250};
constexpr double kNearlyAll = 0.55;   // observations, of all: some points are too far to be told
constexpr double kEnoughPosed = 0.9;  // images, of those that a perspective lens poses
constexpr double kEnoughCommon =
    0.3;                             // observations that both explain, of those that a perspective lens does
constexpr double kSureRatio = 1.05;  // of the rms
// Coefficients that bend the rim to and fro by so many tenths make the polynomial follow a lens of another
// kind.
constexpr double kMostStrain = 5;
// Observations that tell a lens as well as more of them do, which take longer; tried where there are 74,000
// and 145,000.
constexpr int kEnoughObservations = 40000;
constexpr int kMoreNumbers = 2;      // k1 to k4 in the place of k1, k2
constexpr double kMostPosed = 0.7;   // images, of all, where there is no perspective lens
constexpr double kSureFocal = 0.02;  // standard deviation of a focal length, as a part of it

std::vector<Camera> guesses(const Eigen::Vector2d& size) {
  std::vector<Camera> cameras;
  for (const double degrees : kGuesses) {
    const double focal = size.maxCoeff() / (degrees * std::numbers::pi / 180);
    Camera& camera = cameras.emplace_back();
    camera.width = static_cast<int>(size.x());
    camera.height = static_cast<int>(size.y());
    camera.model = KannalaBrandt{focal, focal, 0.5 * (size.x() - 1), 0.5 * (size.y() - 1)};
  }
  return cameras;
}

// Observations that a reconstruction agrees with; of one that does not know its lens, none.
int64_t explained_by(const RayReconstruction& r) {
  return std::isfinite(r.sigma.focal) ? std::ranges::count(r.inlier, 1) : 0;
}

// Whether what lies `from_centre` in an image is seen much nearer to its centre, or farther off the axis,
// than through a perspective lens.
bool is_bent(double from_centre, double focal, const Eigen::Vector3d& direction) {
  const double angle = std::atan2(direction.head<2>().norm(), direction.z());
  return angle > kWideCorner * std::numbers::pi / 180 || from_centre < kBent * focal * std::tan(angle);
}

// Whether its lens bends the outermost of what agrees with it as no perspective one does.
bool is_bent(const PointTracks& tracks, const RayReconstruction& r) {
  Eigen::Vector2d centre;
  if (!r.camera.project(Eigen::Vector3d::UnitZ(), &centre)) return false;
  double farthest = 0;
  Ray ray, outermost;
  for (int k = 0; k < tracks.size(); ++k) {
    const double distance = (tracks.pixel[k] - centre).norm();
    if (!r.inlier[k] || distance < farthest || !r.camera.ray(tracks.pixel[k], &ray)) continue;
    farthest = distance, outermost = ray;
  }
  return farthest > 0 && is_bent(farthest, r.camera.pixels_per_radian(), outermost.direction);
}

// Whether a lens that was found is told, and surely no perspective one.
bool is_other_lens(const PointTracks& tracks, const RayReconstruction& r) {
  return r.sigma.focal < kSureFocal && r.strain <= kMostStrain && is_bent(tracks, r);
}

// Of those that reach enough images the one that explains most, the first where that is nearly all, or as
// much as another lens explains by one that is surely told or a perspective one after all; else the one that
// reaches most.
RayReconstruction best_guess(const PointTracks& tracks, double enough, int64_t by_other,
                             const RayOptions& options) {
  RayReconstruction best;
  int64_t most = -1;
  const auto is_good = [&] {
    return static_cast<double>(most) >= kNearlyAll * tracks.size() ||
           (most >= by_other && (best.sigma.focal < kSureFocal || !is_bent(tracks, best)));
  };
  for (const Camera& guess : guesses(tracks.image_size)) {
    if (is_good() || (options.stopped && options.stopped())) break;
    RayReconstruction r = reconstruct_along_rays(tracks, guess, options);
    const int64_t explained = r.posed >= enough ? explained_by(r) : -1;
    if (explained > most || (most < 0 && r.posed > best.posed)) {
      most = explained;
      best = std::move(r);
    }
  }
  return best;
}

// Sums of squared errors over the observations of points that both place in images that both pose and that
// either explains, each at most that of the largest error allowed.
struct Errors {
  double perspective = 0, along_rays = 0;
  int observations = 0;

  double ratio() const { return std::sqrt(perspective / std::max(along_rays, 1e-12)); }
  double rms(double sum) const { return std::sqrt(sum / std::max(1, observations)); }
};

Errors compare(const PointTracks& tracks, const PerspectiveFit& perspective,
               const RayReconstruction& along_rays, double max_error) {
  Errors errors;
  const double most = max_error * max_error;
  for (int k = 0; k < tracks.size(); ++k) {
    const int image = tracks.image[k], point = tracks.point[k];
    Eigen::Vector2d residual;
    if (!(perspective.inlier[k] || along_rays.inlier[k]) || !perspective.image_posed[image] ||
        !perspective.point_placed[point] || !along_rays.image_posed[image] || !along_rays.point_placed[point])
      continue;
    const bool is_seen = along_rays.inlier[k] && pixel_residual(tracks, along_rays, k, &residual);
    errors.along_rays += is_seen ? residual.squaredNorm() : most;
    errors.perspective += perspective.inlier[k]
                              ? pixel_residual(tracks, perspective.scene, perspective.radial, k).squaredNorm()
                              : most;
    ++errors.observations;
  }
  return errors;
}

bool is_surely_better(const Errors& errors) {
  const double variance = errors.along_rays / std::max(1, 2 * errors.observations);
  const double gain = (errors.perspective - errors.along_rays) / std::max(variance, 1e-12);
  const double needed = kMoreNumbers * std::log(std::max(2, 2 * errors.observations));
  return gain > needed && errors.ratio() > kSureRatio;
}

// Of every so many points one, with all that is seen of it, or all points where that is not too much; of
// `inlier` what belongs to them.
PointTracks thinned(const PointTracks& tracks, std::span<const uint8_t> inlier, std::vector<uint8_t>* kept) {
  const int step = (tracks.size() + kEnoughObservations - 1) / kEnoughObservations;
  PointTracks few;
  few.image_count = tracks.image_count;
  few.point_count = tracks.point_count;
  few.image_size = tracks.image_size;
  for (int k = 0; k < tracks.size(); ++k) {
    if (tracks.point[k] % step != 0) continue;
    few.add(tracks.image[k], tracks.point[k], tracks.pixel[k]);
    if (!inlier.empty()) kept->push_back(inlier[k]);
  }
  return few;
}

WideLensSearch find_alone(const PointTracks& tracks, const RayOptions& options) {
  WideLensSearch search;
  const double enough = kMostPosed * tracks.image_count;
  RayReconstruction r = best_guess(tracks, enough, tracks.size(), options);
  if (r.posed < enough || !is_other_lens(tracks, r)) return search;
  search.compared = true;
  search.evidence = fmt::format("a {} lens where no perspective one is told", model_name(r.camera.model));
  search.found = std::move(r);
  return search;
}

WideLensSearch compared_with(const PointTracks& tracks, const PerspectiveFit& perspective,
                             const RayOptions& options) {
  WideLensSearch search;
  const double enough = kEnoughPosed * static_cast<double>(std::ranges::count(perspective.image_posed, 1));
  const int64_t explained_by_perspective = std::ranges::count(perspective.inlier, 1);
  RayReconstruction r = best_guess(tracks, enough, explained_by_perspective, options);
  if (r.posed < enough || !std::isfinite(r.sigma.focal)) return search;
  const Errors errors = compare(tracks, perspective, r, options.max_error_px);
  if (errors.observations < kEnoughCommon * static_cast<double>(explained_by_perspective)) return search;
  search.compared = true;
  search.evidence =
      fmt::format("rms {:.2f} px with a perspective lens, {:.2f} px with a {} one",
                  errors.rms(errors.perspective), errors.rms(errors.along_rays), model_name(r.camera.model));
  if (is_surely_better(errors) && is_other_lens(tracks, r)) search.found = std::move(r);
  return search;
}

}  // namespace

bool may_be_wide_lens(const PointTracks& tracks, const PerspectiveFit& perspective) {
  const auto image = std::ranges::find(perspective.image_posed, 1) - perspective.image_posed.begin();
  if (image == std::ssize(perspective.image_posed)) return false;
  Lens lens = perspective.scene.lenses[image];
  lens.cx = lens.cy = 0;
  const Camera camera = frame_lens(lens, perspective.radial).camera;
  const Eigen::Vector2d corner = 0.5 * tracks.image_size;
  Ray ray;
  return !camera.ray(corner, &ray) || is_bent(corner.norm(), lens.fx, ray.direction);
}

WideLensSearch find_wide_lens(const PointTracks& tracks, const PerspectiveFit* perspective,
                              const RayOptions& options) {
  std::vector<uint8_t> inlier;
  const PointTracks few =
      thinned(tracks, perspective ? perspective->inlier : std::span<const uint8_t>(), &inlier);
  if (!perspective) return find_alone(few, options);
  const PerspectiveFit fit{perspective->scene, perspective->radial, perspective->image_posed,
                           perspective->point_placed, inlier};
  return compared_with(few, fit, options);
}

}  // namespace raysfm
