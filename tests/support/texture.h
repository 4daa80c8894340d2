#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/image/image.h"

namespace raysfm::testing_support {

// A smooth random function of the plane, a sum of plane waves none shorter than `shortest` pixels, so that
// its samples at whole pixels hold all of it. Mean 128, standard deviation `deviation` grey levels.
class Texture {
 public:
  Texture(uint64_t seed, double shortest, double longest, double deviation) {
    constexpr int kWaves = 40;
    Rng rng(seed, 77);
    for (int i = 0; i < kWaves; ++i) {
      const double length = shortest * std::pow(longest / shortest, rng.uniform());
      const double direction = rng.uniform(0, 2 * std::numbers::pi);
      const double k = 2 * std::numbers::pi / length;
      waves_.push_back(
          {k * std::cos(direction), k * std::sin(direction), rng.uniform(0, 2 * std::numbers::pi)});
    }
    amplitude_ = deviation * std::sqrt(2.0 / kWaves);
  }

  double operator()(const Eigen::Vector2d& p) const {
    double sum = 0;
    for (const Wave& w : waves_) sum += w.share * std::sin(w.kx * p.x() + w.ky * p.y() + w.phase);
    return 128 + amplitude_ * sum;
  }

  // The same, seen through a Gaussian blur of `sigma` pixels.
  Texture blurred(double sigma) const {
    Texture out = *this;
    for (Wave& w : out.waves_) w.share *= std::exp(-0.5 * sigma * sigma * (w.kx * w.kx + w.ky * w.ky));
    return out;
  }

 private:
  struct Wave {
    double kx, ky, phase;
    double share = 1;  // of the amplitude
  };
  std::vector<Wave> waves_;
  double amplitude_;
};

inline uint8_t to_grey(double v) {
  return static_cast<uint8_t>(std::clamp(v + 0.5, 0.0, 255.0));
}

// Pixel p of the image is gain * texture(place_of(p)) + bias plus normal noise of `sigma` grey levels.
template <typename F>
GrayImage render(const Texture& texture, int width, int height, F place_of, double gain = 1, double bias = 0,
                 double sigma = 0, uint64_t seed = 0) {
  GrayImage image(width, height);
  Rng rng(seed, 78);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double noise = sigma > 0 ? sigma * rng.normal() : 0;
      image.row(y)[x] = to_grey(gain * texture(place_of(Eigen::Vector2d(x, y))) + bias + noise);
    }
  }
  return image;
}

inline GrayImage random_image(int width, int height, uint64_t seed) {
  GrayImage image(width, height);
  Rng rng(seed, 79);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.row(y)[x] = static_cast<uint8_t>(rng.index(256));
  }
  return image;
}

}  // namespace raysfm::testing_support
