#include "raysfm/features/patch_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::render;
using testing_support::Texture;

constexpr int kWidth = 240, kHeight = 180;

// Patches on a lattice of a textured reference, at all fractions of a pixel.
std::vector<Eigen::Vector2f> lattice() {
  std::vector<Eigen::Vector2f> pixels;
  Rng rng(1);
  for (int y = 20; y < kHeight - 20; y += 10) {
    for (int x = 20; x < kWidth - 20; x += 10) {
      pixels.emplace_back(x + rng.uniform(-0.5, 0.5), y + rng.uniform(-0.5, 0.5));
    }
  }
  return pixels;
}

struct Errors {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double rms = 0;  // per coordinate
  int converged = 0, total = 0;
};

// The target is the reference moved by `shift`; the search starts `start` away from the true place.
Errors measure(const Eigen::Vector2d& shift, const Eigen::Vector2d& start, double gain, double bias,
               double sigma, double shortest = 6) {
  const Texture texture(2, shortest, 40, 30);
  const GrayImage reference = render(
      texture, kWidth, kHeight, [](const Eigen::Vector2d& p) { return p; }, 1, 0, sigma, 1);
  const auto place = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p - shift; };
  const GrayImage target = render(texture, kWidth, kHeight, place, gain, bias, sigma, 2);
  const auto pixels = lattice();
  const std::vector<Eigen::Matrix2f> identity(pixels.size(), Eigen::Matrix2f::Identity());
  std::vector<Eigen::Vector2f> initial;
  for (const auto& p : pixels) initial.push_back(p + (shift + start).cast<float>());
  std::vector<PatchAlignment> out(pixels.size());
  PatchAligner().align(reference.view(), pixels, identity, target.view(), initial, out);

  Errors errors;
  errors.total = static_cast<int>(pixels.size());
  for (size_t i = 0; i < out.size(); ++i) {
    if (!out[i].converged) continue;
    const Eigen::Vector2d error = (out[i].pixel - pixels[i]).cast<double>() - shift;
    errors.mean += error;
    errors.rms += error.squaredNorm() / 2;
    ++errors.converged;
  }
  errors.mean /= errors.converged;
  errors.rms = std::sqrt(errors.rms / errors.converged);
  return errors;
}

TEST(PatchAlignment, NoBiasAtAnyFractionOfAPixel) {
  for (const Eigen::Vector2d& shift :
       {Eigen::Vector2d(0, 0), {0.25, 0.5}, {0.5, 0.5}, {-0.3, 0.7}, {2.1, -1.4}}) {
    const Errors e = measure(shift, {0.4, -0.3}, 1, 0, 0);
    EXPECT_GT(e.converged, 0.98 * e.total) << shift.transpose();
    EXPECT_LT(e.mean.norm(), 0.01) << shift.transpose();
    EXPECT_LT(e.rms, 0.03) << shift.transpose();
  }
}

TEST(PatchAlignment, GainAndBiasOfTheBrightnessDoNotMatter) {
  const Errors e = measure({0.3, -0.2}, {0.4, -0.3}, 0.6, 35, 0);
  EXPECT_GT(e.converged, 0.98 * e.total);
  EXPECT_LT(e.mean.norm(), 0.01);
  EXPECT_LT(e.rms, 0.03);
}

// With noise in both images the deviation is sqrt(2) sigma over the root of the normal matrix; for this
// texture the bound is about 0.03 pixels.
TEST(PatchAlignment, NoiseOfTwoGreyLevels) {
  const Errors e = measure({0.3, -0.2}, {0.4, -0.3}, 1, 0, 2);
  EXPECT_GT(e.converged, 0.97 * e.total);
  EXPECT_LT(e.mean.norm(), 0.01);
  EXPECT_LT(e.rms, 0.05);
  RecordProperty("rms_px", std::to_string(e.rms));
}

TEST(PatchAlignment, ComesBackFromAPixelAndAHalf) {
  const Errors e = measure({0.3, -0.2}, {1.2, 0.9}, 1, 0, 2, 10);
  EXPECT_GT(e.converged, 0.9 * e.total);
  EXPECT_LT(e.rms, 0.1);
}

TEST(PatchAlignment, WarpsThePatchOfTheReference) {
  const Texture texture(3, 8, 40, 30);
  Eigen::Matrix2d m;  // reference from target
  m << 1.15, 0.2, -0.25, 0.95;
  const Eigen::Vector2d centre(60, 60);
  const GrayImage reference = render(texture, 120, 120, [](const Eigen::Vector2d& p) { return p; });
  const GrayImage target = render(texture, 120, 120, [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return centre + m * (p - centre);
  });
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector2f truth(50 + i, 68 - i);
    const Eigen::Vector2f pixel = (centre + m * (truth.cast<double>() - centre)).cast<float>();
    const Eigen::Matrix2f warp = m.cast<float>();
    const Eigen::Vector2f initial = truth + Eigen::Vector2f(0.6f, -0.5f);
    PatchAlignment out;
    PatchAligner().align(reference.view(), {&pixel, 1}, {&warp, 1}, target.view(), {&initial, 1}, {&out, 1});
    ASSERT_TRUE(out.converged);
    EXPECT_LT((out.pixel - truth).norm(), 0.03f);
    EXPECT_GT(out.zncc, 0.995f);
  }
}

TEST(PatchAlignment, RejectsWhatItCannotKnow) {
  const Texture texture(4, 6, 30, 30), another(5, 6, 30, 30);
  const auto identity = [](const Eigen::Vector2d& p) { return p; };
  const auto rows = [](const Eigen::Vector2d& p) { return Eigen::Vector2d(0, p.y()); };
  const GrayImage image = render(texture, 100, 100, identity), other = render(another, 100, 100, identity);
  const GrayImage stripes = render(texture, 100, 100, rows);
  const GrayImage negative = render(texture, 100, 100, identity, -1, 255);
  const Eigen::Matrix2f warp = Eigen::Matrix2f::Identity();
  const auto converges = [&](const GrayImage& reference, const GrayImage& target,
                             const Eigen::Vector2f& pixel, const Eigen::Vector2f& initial) {
    PatchAlignment out;
    PatchAligner().align(reference.view(), {&pixel, 1}, {&warp, 1}, target.view(), {&initial, 1}, {&out, 1});
    EXPECT_TRUE(out.converged || out.pixel == initial || !initial.allFinite());
    return out.converged;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(converges(image, image, {50, 50}, {50, 50}));
  EXPECT_FALSE(converges(stripes, stripes, {50, 50}, {50, 50}));  // slides along the stripes
  EXPECT_FALSE(converges(image, other, {50, 50}, {50, 50}));      // another scene
  EXPECT_FALSE(converges(image, negative, {50, 50}, {50, 50}));   // opposite contrast
  EXPECT_FALSE(converges(image, image, {50, 50}, {50, 60}));      // too far
  EXPECT_FALSE(converges(image, image, {4, 50}, {50, 50}));       // leaves the reference
  EXPECT_FALSE(converges(image, image, {50, 50}, {4, 50}));       // leaves the target
  EXPECT_FALSE(converges(image, image, {50, 50}, {97, 99}));
  EXPECT_FALSE(converges(image, image, {nan, 50}, {50, 50}));
  EXPECT_FALSE(converges(image, image, {50, 50}, {50, nan}));
  EXPECT_FALSE(converges(image, image, {50, 50}, {1e20f, 50}));
  EXPECT_FALSE(converges(GrayImage(5, 5), image, {2, 2}, {50, 50}));
}

TEST(PatchAlignment, EveryInstructionSetGivesTheSameBits) {
  const Texture texture(6, 6, 40, 30);
  const GrayImage a = render(
      texture, kWidth, kHeight, [](const Eigen::Vector2d& p) { return p; }, 1, 0, 2, 1);
  const auto place = [](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return 1.02 * p + Eigen::Vector2d(0.3, 0.1);
  };
  const GrayImage b = render(texture, kWidth, kHeight, place, 0.9, 5, 2, 2);
  const auto pixels = lattice();
  const std::vector<Eigen::Matrix2f> warps(pixels.size(), Eigen::Matrix2f::Identity() * 1.01f);
  std::vector<PatchAlignment> reference(pixels.size()), out(pixels.size());
  PatchAligner().align(a.view(), pixels, warps, b.view(), pixels, reference);
  int converged = 0;
  for_each_instruction_set([&](const char* name) {
    PatchAligner().align(a.view(), pixels, warps, b.view(), pixels, out);
    for (size_t i = 0; i < out.size(); ++i) {
      ASSERT_EQ(out[i].pixel, reference[i].pixel) << name;
      ASSERT_EQ(out[i].zncc, reference[i].zncc) << name;
      converged += out[i].converged;
    }
  });
  EXPECT_GT(converged, 100);
}

}  // namespace
}  // namespace raysfm
