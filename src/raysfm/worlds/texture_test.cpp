#include "raysfm/worlds/texture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "raysfm/worlds/materials.h"

namespace raysfm::synth {
namespace {

constexpr float kTwoPi = 2.f * std::numbers::pi_v<float>;

TEST(Texture, ReturnsWhatWasPainted) {
  ThreadPool pool(2);
  const Texture texture(
      64, [](float u, float v) { return Colour(200.f * u, 200.f * v, 17.f); }, pool);
  for (int y = 0; y < 63; ++y) {
    for (int x = 0; x < 63; ++x) {
      const float u = (x + 0.5f) / 64, v = (y + 0.5f) / 64;
      const Colour centre = texture.sample(u, v, 0.f), between = texture.sample(u + 0.5f / 64, v, 0.f);
      EXPECT_NEAR(centre.x(), 200.f * u, 0.51f);
      EXPECT_NEAR(centre.y(), 200.f * v, 0.51f);
      EXPECT_NEAR(between.x(), 200.f * (u + 0.5f / 64), 0.52f);
      EXPECT_NEAR(between.z(), 17.f, 0.01f);
    }
  }
}

TEST(Texture, IsPeriodic) {
  ThreadPool pool(0);
  MaterialLibrary library(pool);
  const Texture& texture = library.noise();
  for (float u = 0.013f; u < 1.f; u += 0.1f) {
    const Colour here = texture.sample(u, 0.3f, 0.01f);
    for (const float period : {-7.f, 1.f, 20.f}) {
      EXPECT_LT((texture.sample(u + period, 0.3f - period, 0.01f) - here).abs().maxCoeff(), 1.5f);
    }
  }
}

// A wave keeps its place at every footprint: the phase of its first harmonic is that of the painted wave.
TEST(Texture, NoFootprintMovesThePicture) {
  ThreadPool pool(0);
  const Texture texture(
      128, [](float u, float) { return Colour::Constant(128.f + 100.f * std::sin(4 * kTwoPi * u)); }, pool);
  for (const float footprint : {0.f, 0.01f, 0.013f, 0.02f, 0.03f, 0.05f}) {
    std::complex<double> harmonic = 0;
    for (int i = 0; i < 4096; ++i) {
      const float u = i / 4096.f;
      harmonic +=
          std::polar(1.0, -4.0 * kTwoPi * u) * static_cast<double>(texture.sample(u, 0.4f, footprint).x());
    }
    const double phase = std::arg(harmonic) + std::numbers::pi / 2;  // of a sine
    EXPECT_NEAR(phase / (4 * kTwoPi) * 128, 0, 0.02) << "texels, footprint " << footprint;
    EXPECT_GT(std::abs(harmonic) / 4096, footprint < 0.02f ? 45 : 10);
  }
}

TEST(Texture, LargeFootprintIsTheMean) {
  ThreadPool pool(0);
  const Texture texture(
      64, [](float u, float v) { return Colour::Constant((u < 0.5f) == (v < 0.5f) ? 40.f : 200.f); }, pool);
  EXPECT_NEAR(texture.sample(0.2f, 0.9f, 3.f).x(), 120.f, 1.f);
}

TEST(Materials, EveryPatternHasContrastAndIsPaintedOnce) {
  ThreadPool pool(2);
  MaterialLibrary library(pool);
  for (int p = static_cast<int>(Pattern::kBrick); p <= static_cast<int>(Pattern::kShutter); ++p) {
    const int number = library.find(static_cast<Pattern>(p), 1);
    EXPECT_EQ(library.find(static_cast<Pattern>(p), 1), number);
    const Texture& texture = library.texture(number);
    double sum = 0, sum2 = 0;
    for (int i = 0; i < 1000; ++i) {
      const double g = texture.sample(0.37f * i, 0.61803f * i, 0.f).mean();
      sum += g / 1000;
      sum2 += g * g / 1000;
    }
    EXPECT_GT(std::sqrt(sum2 - sum * sum), 6) << "pattern " << p;
    EXPECT_GT(sum, 25) << "pattern " << p;
    EXPECT_LT(sum, 230) << "pattern " << p;
  }
}

}  // namespace
}  // namespace raysfm::synth
