#include "raysfm/features/coarse_rotation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>

#include "raysfm/features/shift_search.h"
#include "raysfm/image/pyramid.h"
#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::random_image;
using testing_support::render;
using testing_support::Texture;

constexpr int kTurnedWidth = 320, kTurnedHeight = 240;

// Error of the estimate, worst over the image, full-size pixels, when the second image is the first moved.
double worst_error(const Eigen::Vector2d& shift, double angle, double gain = 1, double sigma = 3) {
  const Texture texture(1, 25, 250, 35);
  const Eigen::Vector2d centre(0.5 * (kTurnedWidth - 1), 0.5 * (kTurnedHeight - 1));
  const Eigen::Rotation2Dd turn(angle);
  const GrayImage first = render(
      texture, kTurnedWidth, kTurnedHeight, [](const Eigen::Vector2d& p) { return p; }, 1, 0, sigma, 1);
  const GrayImage second = render(
      texture, kTurnedWidth, kTurnedHeight,
      [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
        return centre + turn.inverse() * (p - shift - centre);
      },
      gain, 128 * (1 - gain), sigma, 2);
  GrayImage a, b;
  const int side = make_thumbnail(first.view(), 80, &a);
  make_thumbnail(second.view(), 80, &b);
  const CoarseMotion motion = estimate_coarse_motion(a.view(), b.view(), static_cast<float>(side));
  EXPECT_GT(motion.zncc, 0.9f);
  double worst = 0;
  for (const Eigen::Vector2d& p :
       {Eigen::Vector2d(0, 0), {kTurnedWidth, 0}, {0, kTurnedHeight}, {kTurnedWidth, kTurnedHeight}}) {
    const Eigen::Vector2d truth = centre + turn * (p - centre) + shift;
    worst = std::max(
        worst, (motion.apply(p.cast<float>(), kTurnedWidth, kTurnedHeight).cast<double>() - truth).norm());
  }
  return worst;
}

TEST(CoarseMotion, FindsShiftAndAngle) {
  EXPECT_LT(worst_error({0, 0}, 0), 0.5);
  EXPECT_LT(worst_error({1.3, -2.6}, 0.02), 0.5);
  EXPECT_LT(worst_error({40, 12}, 0), 0.5);
  EXPECT_LT(worst_error({-65, 30}, 0.03), 1.0);
  EXPECT_LT(worst_error({20, -30}, -0.12), 1.0);
  EXPECT_LT(worst_error({20, -30}, 0.05, 0.6), 1.0);
}

TEST(CoarseMotion, SaysWhereItFoundNothing) {
  const GrayImage a = random_image(80, 60, 1), b = random_image(80, 60, 2), small = random_image(8, 6, 1);
  GrayImage flat(80, 60);
  for (int y = 0; y < 60; ++y) std::fill_n(flat.row(y), 80, uint8_t{9});
  EXPECT_LT(estimate_coarse_motion(a.view(), b.view(), 8).zncc, 0.5f);
  EXPECT_EQ(estimate_coarse_motion(a.view(), flat.view(), 8).zncc, 0);
  EXPECT_EQ(estimate_coarse_motion(flat.view(), flat.view(), 8).zncc, 0);
  EXPECT_EQ(estimate_coarse_motion(a.view(), small.view(), 8).zncc, 0);
  EXPECT_EQ(estimate_coarse_motion(small.view(), small.view(), 8).zncc, 0);
  EXPECT_EQ(estimate_coarse_motion({}, {}, 8).zncc, 0);
}

TEST(ShiftSearch, FindsTheShiftThatWasMade) {
  const GrayImage large = random_image(80, 80, 3);
  for (const Eigen::Vector2i& shift : {Eigen::Vector2i(0, 0), {10, 7}, {-10, -7}, {3, -5}}) {
    const auto crop = [&](int x, int y) { return GrayView{large.row(y) + x, 40, 30, large.view().stride}; };
    const ShiftSearchResult found = search_shift(crop(20, 20), crop(20 - shift.x(), 20 - shift.y()));
    EXPECT_EQ(found.shift, shift);
    EXPECT_NEAR(found.zncc, 1, 1e-4);
  }
  EXPECT_EQ(search_shift(random_image(49, 20, 1).view(), random_image(49, 20, 1).view()).zncc, 0);
}

TEST(CoarseMotion, EveryInstructionSetGivesTheSameBits) {
  const Texture texture(4, 8, 60, 35);
  const GrayImage a = render(texture, 100, 75, [](const Eigen::Vector2d& p) { return p; });
  const GrayImage b = render(texture, 100, 75, [](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return Eigen::Rotation2Dd(0.05) * p + Eigen::Vector2d(5.3, -2.1);
  });
  const CoarseMotion reference = estimate_coarse_motion(a.view(), b.view(), 8);
  EXPECT_GT(reference.zncc, 0.9f);
  for_each_instruction_set([&](const char* name) {
    const CoarseMotion motion = estimate_coarse_motion(a.view(), b.view(), 8);
    EXPECT_EQ(motion.shift, reference.shift) << name;
    EXPECT_EQ(motion.angle, reference.angle) << name;
    EXPECT_EQ(motion.zncc, reference.zncc) << name;
  });
}

}  // namespace
}  // namespace raysfm
