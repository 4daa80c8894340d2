#include "raysfm/uncalibrated/scene_growth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "raysfm/core/median.h"
#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/geometry/triangulation.h"
#include "raysfm/projective/eight_point.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/solvers/five_point.h"
#include "raysfm/uncalibrated/video_resection.h"

namespace raysfm {
namespace {

constexpr double kLeastAngle = 0.02;  // radians between the rays of a point
constexpr int kLeastInliers = 15;     // of an image
constexpr double kLeastShare = 0.25;  // of its placed points

Ray ray_of_pixel(const Rigid3& cam_from_world, const Lens& lens, const Eigen::Vector2d& pixel) {
  const double y = (pixel.y() - lens.cy) / lens.fy;
  const double x = (pixel.x() - lens.cx - lens.skew * y) / lens.fx;
  const Rigid3 world_from_cam = cam_from_world.inverse();
  return {world_from_cam.translation, world_from_cam.rotation * Eigen::Vector3d(x, y, 1).normalized()};
}

// Numbers of the observations of each point.
std::vector<std::vector<int>> observations_of_points(const PointTracks& tracks) {
  std::vector<std::vector<int>> observations(tracks.point_count);
  for (int k = 0; k < tracks.size(); ++k) observations[tracks.point[k]].push_back(k);
  return observations;
}

// From all rays, or from the two that agree with most.
bool place_point(const PointTracks& tracks, std::span<const int> observations, double max_error,
                 const UncalibratedScene& scene, Eigen::Vector3d* point) {
  std::vector<Ray> rays;
  for (const int k : observations) {
    const int j = tracks.image[k];
    rays.push_back(ray_of_pixel(scene.cam_from_world[j], scene.lenses[j], tracks.pixel[k]));
  }
  const auto agreeing = [&](const Eigen::Vector3d& x) {
    return std::ranges::count_if(observations, [&](int k) {
      const int j = tracks.image[k];
      return pixel_residual(scene.cam_from_world[j], scene.lenses[j], {}, x, tracks.pixel[k]).norm() <
             max_error;
    });
  };
  Triangulation whole;
  if (triangulate(rays, &whole) && whole.parallax > kLeastAngle &&
      agreeing(whole.point) == std::ssize(rays)) {
    *point = whole.point;
    return true;
  }
  std::ptrdiff_t most = 2;
  for (size_t a = 0; a < rays.size(); ++a) {
    const size_t b = (a + (rays.size() + 1) / 2) % rays.size();
    Eigen::Vector3d x;
    if (angle_between(rays[a].direction, rays[b].direction) < kLeastAngle) continue;
    if (!triangulate_midpoint(rays[a], rays[b], &x)) continue;
    const std::ptrdiff_t count = agreeing(x);
    if (count > most) *point = x, most = count;
  }
  return most > 2 && 2 * most > std::ssize(rays);
}

// An image's points that are placed, and where it sees them.
struct KnownPoints {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
};

KnownPoints known_points(const PointTracks& tracks, const ImageObservations& observations, int image,
                         const GrowingScene& scene) {
  KnownPoints known;
  for (const int* k = observations.begin(image); k != observations.end(image); ++k) {
    if (!scene.point_placed[tracks.point[*k]]) continue;
    known.points.push_back(scene.scene.points[tracks.point[*k]]);
    known.pixels.push_back(tracks.pixel[*k]);
  }
  return known;
}

// The lens whose focal length is the middle one of the posed images.
Lens middle_lens(const GrowingScene& scene) {
  std::vector<double> focals;
  for (size_t j = 0; j < scene.image_posed.size(); ++j) {
    if (scene.image_posed[j]) focals.push_back(scene.scene.lenses[j].fx);
  }
  const double middle = median_of(&focals);
  for (size_t j = 0; j < scene.image_posed.size(); ++j) {
    if (scene.image_posed[j] && scene.scene.lenses[j].fx == middle) return scene.scene.lenses[j];
  }
  return {};
}

// Pose and lens by known points; the number of those that agree, 0 where too few do.
int resect(const KnownPoints& known, const Lens& lens, bool zooming, const SolveOptions& options, int image,
           LensResection* result) {
  Rig rig;
  rig.cameras.resize(1);
  rig.cameras[0].model = Pinhole{lens.fx, lens.fy, lens.cx, lens.cy};
  PoseOptions pose_options;
  // Another focal length makes errors at the rim of the image.
  pose_options.max_error_px = (zooming ? 4 : 2) * options.max_error_px;
  pose_options.min_inliers = kLeastInliers;
  pose_options.seed = options.seed;
  pose_options.stream = static_cast<uint64_t>(image);
  PoseEstimate pose;
  PoseEstimator().estimate(rig, {.points_in_world = known.points, .pixels = known.pixels}, nullptr,
                           pose_options, &pose);
  if (!pose.ok()) return 0;
  KnownPoints agreeing;
  for (size_t i = 0; i < known.points.size(); ++i) {
    if (!pose.inlier[i]) continue;
    agreeing.points.push_back(known.points[i]);
    agreeing.pixels.push_back(known.pixels[i]);
  }
  const LensResectionOptions refinement{.max_error_px = pose_options.max_error_px,
                                        .zooming = zooming,
                                        .principal_point_sigma_px = 0.01 * lens.fx,
                                        .min_inliers = kLeastInliers,
                                        .seed = options.seed};
  if (!resect_with_lens(agreeing.points, agreeing.pixels, pose.rig_from_world, lens, refinement, result))
    return 0;
  const bool enough = result->inlier_count >= kLeastShare * static_cast<double>(known.points.size());
  return enough ? result->inlier_count : 0;
}

// The same over focal lengths about that of the others, where lenses zoom.
bool pose_left_image(const KnownPoints& known, const Lens& lens, bool zooming, const SolveOptions& options,
                     int image, GrowingScene* scene) {
  constexpr std::array kFactors = {1.0, 0.8, 1.25, 0.62, 1.6};
  int most = 0;
  for (const double factor : kFactors) {
    if (factor != 1 && !zooming) break;
    Lens tried = lens;
    tried.fx *= factor, tried.fy *= factor;
    LensResection found;
    const int count = resect(known, tried, zooming, options, image, &found);
    if (count <= most) continue;
    most = count;
    scene->scene.cam_from_world[image] = found.cam_from_world;
    scene->scene.lenses[image] = found.lens;
  }
  scene->image_posed[image] = most > 0;
  return most > 0;
}

// Squares of the distances of the inliers of a pair from the epipolar lines of an essential matrix, each at
// most that of the largest error.
double epipolar_cost(const ViewPair& pair, const Eigen::Matrix3d& essential, const Eigen::Matrix3d& inverse_k,
                     double max_error) {
  const Eigen::Matrix3d fundamental = inverse_k.transpose() * essential * inverse_k;
  double sum = 0;
  for (size_t i = 0; i < pair.matches.a.size(); ++i) {
    if (!pair.inlier[i]) continue;
    sum += std::min(max_error * max_error, sampson_error2(fundamental, pair.matches.a[i], pair.matches.b[i]));
  }
  return sum;
}

// A fundamental matrix is that of lenses of a given focal length but for noise, which may be much where the
// images are narrow.
Eigen::Matrix3d best_essential(const ViewPair& pair, const Lens& lens,
                               const std::vector<Eigen::Vector3d>& first,
                               const std::vector<Eigen::Vector3d>& second, const SolveOptions& options) {
  constexpr int kSamples = 200, kSize = 5;
  const Eigen::Matrix3d k = lens.matrix(), inverse_k = k.inverse();
  Rigid3 pose;
  choose_pose(k.transpose() * pair.fundamental * k, first, second, &pose);
  Eigen::Matrix3d best = skew(pose.translation) * pose.rotation.toRotationMatrix();
  double least = epipolar_cost(pair, best, inverse_k, options.max_error_px);
  Rng rng(options.seed, static_cast<uint64_t>(pair.images[0]));
  for (int s = 0; s < kSamples && first.size() >= kSize; ++s) {
    std::array<Eigen::Vector3d, kSize> a, b;
    for (int i = 0; i < kSize; ++i) {
      const uint32_t match = rng.index(static_cast<uint32_t>(first.size()));
      a[i] = first[match], b[i] = second[match];  // one taken twice gives nothing good
    }
    std::array<Eigen::Matrix3d, 10> essentials;
    const int count = five_point(a, b, &essentials);
    for (int e = 0; e < count; ++e) {
      const double cost = epipolar_cost(pair, essentials[e], inverse_k, options.max_error_px);
      if (cost < least) least = cost, best = essentials[e];
    }
  }
  return best;
}

}  // namespace

int GrowingScene::posed() const {
  return static_cast<int>(std::ranges::count(image_posed, 1));
}

bool euclidean_start(const PointTracks& tracks, const ViewPair& pair, double focal,
                     const SolveOptions& options, GrowingScene* scene) {
  const Lens lens{focal, focal, tracks.centre().x(), tracks.centre().y(), 0};
  std::vector<Eigen::Vector3d> bearings[2];
  for (size_t i = 0; i < pair.matches.a.size(); ++i) {
    if (!pair.inlier[i]) continue;
    bearings[0].push_back(ray_of_pixel({}, lens, pair.matches.a[i]).direction);
    bearings[1].push_back(ray_of_pixel({}, lens, pair.matches.b[i]).direction);
  }
  const Eigen::Matrix3d essential = best_essential(pair, lens, bearings[0], bearings[1], options);
  Rigid3 second_from_first;
  const int in_front = choose_pose(essential, bearings[0], bearings[1], &second_from_first);
  if (2 * in_front < pair.inliers) return false;
  scene->scene.cam_from_world.assign(tracks.image_count, Rigid3{});
  scene->scene.lenses.assign(tracks.image_count, lens);
  scene->scene.points.assign(tracks.point_count, Eigen::Vector3d::Zero());
  scene->image_posed.assign(tracks.image_count, 0);
  scene->point_placed.assign(tracks.point_count, 0);
  scene->scene.cam_from_world[pair.images[1]] = second_from_first;
  scene->image_posed[pair.images[0]] = scene->image_posed[pair.images[1]] = 1;
  return true;
}

void place_left_points(const PointTracks& tracks, double max_error_px, GrowingScene* scene) {
  const std::vector<std::vector<int>> observations = observations_of_points(tracks);
  for (int i = 0; i < tracks.point_count; ++i) {
    if (scene->point_placed[i]) continue;
    std::vector<int> seen;
    for (const int k : observations[i]) {
      if (scene->image_posed[tracks.image[k]]) seen.push_back(k);
    }
    if (seen.size() < 2) continue;
    scene->point_placed[i] = place_point(tracks, seen, max_error_px, scene->scene, &scene->scene.points[i]);
  }
}

int pose_left_images(const PointTracks& tracks, const SolveOptions& options, bool zooming,
                     GrowingScene* scene) {
  const ImageObservations observations(tracks);
  std::vector<uint8_t> tried(tracks.image_count, 0);
  int posed = 0;
  while (!options.stopped()) {
    int best = -1;
    KnownPoints most;
    for (int j = 0; j < tracks.image_count; ++j) {
      if (scene->image_posed[j] || tried[j]) continue;
      KnownPoints known = known_points(tracks, observations, j, *scene);
      if (best < 0 || known.points.size() > most.points.size()) best = j, most = std::move(known);
    }
    if (best < 0 || static_cast<int>(most.points.size()) < kLeastInliers) return posed;
    tried[best] = 1;
    if (!pose_left_image(most, middle_lens(*scene), zooming, options, best, scene)) continue;
    ++posed;
    place_left_points(tracks, options.max_error_px, scene);
    std::ranges::copy(scene->image_posed, tried.begin());
  }
  return posed;
}

}  // namespace raysfm
