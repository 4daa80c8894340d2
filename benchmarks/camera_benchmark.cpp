// Cameras of every model: median time of a ray, of a projection with and without its derivative, and of the
// pixel finder through a table of the camera's rays, nanoseconds a call. Calls go through Camera, as the
// pipeline's do. Usage: camera_benchmark [rounds, default 101]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <type_traits>
#include <vector>

#include "raysfm/camera/fit_ray_table.h"
#include "raysfm/camera/pixel_finder.h"
#include "raysfm/core/random.h"
#include "raysfm/core/timer.h"
#include "support/model_fixtures.h"

namespace {

using namespace raysfm;

double checksum = 0;  // keeps the compiler from dropping the work

// Median over rounds of the time of a pass over `count` items, per item.
template <typename Pass>
double nanoseconds(int rounds, size_t count, Pass pass) {
  std::vector<double> times;
  for (int i = 0; i < rounds; ++i) {
    const Clock::time_point start = Clock::now();
    pass();
    times.push_back(1e6 * milliseconds_since(start) / static_cast<double>(count));
  }
  std::nth_element(times.begin(), times.begin() + rounds / 2, times.end());
  return times[rounds / 2];
}

void measure(const std::string& name, const Camera& camera, int rounds) {
  Rng random(1);
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Eigen::Vector3d> points;
  for (int tries = 0; pixels.size() < 2000 && tries < 100000; ++tries) {
    const Eigen::Vector2d pixel(random.uniform(0, camera.width - 1), random.uniform(0, camera.height - 1));
    Ray ray;
    if (!camera.ray(pixel, &ray)) continue;
    pixels.push_back(pixel);
    points.push_back(ray.origin + random.uniform(1, 5) * ray.direction);
  }
  const PixelFinder finder(camera);
  const double ray_ns = nanoseconds(rounds, pixels.size(), [&] {
    Ray ray;
    for (const Eigen::Vector2d& pixel : pixels) {
      if (camera.ray(pixel, &ray)) checksum += ray.direction.x();
    }
  });
  const auto find = [&](Eigen::Matrix<double, 2, 3>* jacobian) {
    return nanoseconds(rounds, points.size(), [&] {
      Eigen::Vector2d pixel;
      for (const Eigen::Vector3d& point : points) {
        if (finder.find(point, &pixel, jacobian)) checksum += pixel.x();
      }
    });
  };
  Eigen::Matrix<double, 2, 3> jacobian;
  const double plain = find(nullptr), with_derivative = find(&jacobian);
  std::printf("%-20s %8.1f %10.1f %12.1f\n", name.c_str(), ray_ns, plain, with_derivative);
}

template <typename Model>
void measure_model(const Model& model, int rounds) {
  measure(std::string(Model::kName), testing_support::fixture_camera(model), rounds);
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::max(1, std::atoi(argv[1])) : 101;
  std::printf("%-20s %8s %10s %12s\n", "model", "ray", "find", "+ derivative");
  using testing_support::fixtures;
  measure_model(fixtures<Pinhole>()[0], rounds);
  measure_model(fixtures<Radtan>()[1], rounds);
  measure_model(fixtures<Rational>()[0], rounds);
  measure_model(fixtures<KannalaBrandt>()[0], rounds);
  measure_model(fixtures<Unified>()[0], rounds);
  measure_model(fixtures<DoubleSphere>()[0], rounds);
  measure_model(fixtures<Eucm>()[0], rounds);
  measure_model(fixtures<OCam>()[0], rounds);
  measure_model(fixtures<Equirectangular>()[0], rounds);
  measure_model(fixtures<Mirror>()[0], rounds);
  const auto central = fit_ray_table(testing_support::fixture_camera(fixtures<KannalaBrandt>()[0]));
  const auto non_central = fit_ray_table(testing_support::fixture_camera(fixtures<Mirror>()[0]));
  if (central.ok()) measure("ray-table, central", central->camera, rounds);
  if (non_central.ok()) measure("ray-table, mirror", non_central->camera, rounds);
  std::printf("checksum %g\n", checksum);
  return 0;
}
