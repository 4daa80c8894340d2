#include "raysfm/matching/guided_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/model_fixtures.h"
#include "support/panel_world.h"
#include "support/soft_edges.h"

namespace raysfm {
namespace {

Camera test_camera() {
  Camera camera;
  camera.model = Radtan::from_parameters({500, 505, 320, 240, -0.2, 0.05, 0.001, -0.002, 0});
  camera.width = 640;
  camera.height = 480;
  return camera;
}

// In the first octave of an image.
KeyFrameView one_feature(const TrackingRig& rig, const Eigen::Vector2f& pixel, GrayImage image) {
  const ViewPtr view = testing_support::as_view(std::move(image), 0);
  MapKeyFrame keyframe;
  keyframe.add(0, pixel, view->cameras[0].octaves->first(), 0);
  return make_keyframe_view(view, keyframe, rig);
}
KeyFrameView one_feature(const TrackingRig& rig, const Eigen::Vector2f& pixel) {
  return one_feature(rig, pixel, testing_support::flat_image(640, 480, 128));
}

// The patch's deformation must be the derivative of the map pixel -> point on the sphere -> other pixel.
TEST(PredictPatch, WarpIsTheDerivativeOfTheTransfer) {
  const TrackingRig rig(Rig{{test_camera()}});
  const Eigen::Vector2f pixel(400, 150);
  const KeyFrameView keyframe = one_feature(rig, pixel);
  const Rigid3 target_from_keyframe{exp_so3({0.02, -0.1, 0.3}), {0.2, -0.1, -0.8}};
  const double distance = 5.0;
  PatchQuery query;
  ASSERT_TRUE(
      predict_patch(rig, keyframe, 0, distance, 0, target_from_keyframe, keyframe.camera_view(0), &query));

  const auto transfer = [&](const Eigen::Vector2d& p) {
    Ray ray;
    EXPECT_TRUE(rig.camera(0).ray(p, &ray));
    Eigen::Vector2d out;
    EXPECT_TRUE(rig.camera(0).project(target_from_keyframe * (distance * ray.direction), &out));
    return out;
  };
  const Eigen::Vector2d center = pixel.cast<double>();
  EXPECT_LT((transfer(center) - query.predicted.cast<double>()).norm(), 1e-3);
  Eigen::Matrix2d numeric;
  for (int c = 0; c < 2; ++c) {
    const Eigen::Vector2d step = 0.01 * Eigen::Vector2d::Unit(c);
    numeric.col(c) = (transfer(center + step) - transfer(center - step)) / 0.02;
  }
  EXPECT_LT((numeric.inverse() - query.keyframe_from_target.cast<double>()).norm(), 1e-3);
}

// Where rays of a key frame that are a patch's standard deviation aside meet the surface that faces it, as
// the target sees that, less where it sees the middle; the mean over both axes and sides. False where one is
// not seen.
bool mean_shift(const Camera& camera, const Eigen::Vector2d& pixel, double distance,
                const Rigid3& target_from_keyframe, const Eigen::Matrix2d& offsets, Eigen::Vector2d* shift) {
  Ray middle;
  Eigen::Vector2d centre;
  const PixelFinder finder(camera);
  if (!camera.ray(pixel, &middle)) return false;
  const Eigen::Vector3d point = middle.origin + distance * middle.direction;
  if (!finder.find(target_from_keyframe * point, &centre)) return false;
  shift->setZero();
  for (int k = 0; k < 4; ++k) {
    Ray ray;
    Eigen::Vector2d seen;
    if (!camera.ray(pixel + (k % 2 == 0 ? 1 : -1) * offsets.col(k / 2), &ray)) return false;
    const double along = middle.direction.dot(point - ray.origin) / middle.direction.dot(ray.direction);
    if (!finder.find(target_from_keyframe * (ray.origin + along * ray.direction), &seen)) return false;
    if ((seen - centre).norm() > 100) return false;  // round the back of a panorama
    *shift += (seen - centre) / 2;
  }
  return true;
}

template <typename Model>
class BendOf : public testing::Test {};
using Models = testing::Types<Radtan, KannalaBrandt, DoubleSphere, OCam, Equirectangular, Mirror>;
TYPED_TEST_SUITE(BendOf, Models);

TYPED_TEST(BendOf, IsHowFarAPatchLiesBesideItsMiddle) {
  const Camera camera = testing_support::fixture_camera(testing_support::fixtures<TypeParam>()[0]);
  const TrackingRig rig(Rig{{camera}});
  Rng random(3);
  std::vector<double> errors, bends;
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector2f pixel(random.uniform(20, 620), random.uniform(20, 460));
    Ray ray;
    if (!camera.ray(pixel.cast<double>(), &ray)) continue;
    const KeyFrameView keyframe = one_feature(rig, pixel);
    const Rigid3 target_from_keyframe{exp_so3({0.2, -0.15, 0.3}), {0.9, -0.4, -0.7}};
    PatchQuery query;
    if (!predict_patch(rig, keyframe, 0, 4.0, 0, target_from_keyframe, keyframe.camera_view(0), &query))
      continue;
    const Eigen::Matrix2d offsets = std::sqrt(10) * query.keyframe_from_target.cast<double>();
    Eigen::Vector2d shift;
    if (!mean_shift(camera, pixel.cast<double>(), 4.0, target_from_keyframe, offsets, &shift)) continue;
    errors.push_back((query.bend.cast<double>() - shift).norm());
    bends.push_back(shift.norm());
  }
  ASSERT_GT(errors.size(), 40u);
  std::sort(errors.begin(), errors.end());
  std::sort(bends.begin(), bends.end());
  const size_t most = errors.size() * 9 / 10;
  EXPECT_LT(errors[most], 0.1 * bends[most] + 0.002);
}

TEST(PredictPatch, RefusesWhatTheTargetDoesNotSee) {
  const TrackingRig rig(Rig{{test_camera()}});
  const KeyFrameView keyframe = one_feature(rig, {320, 240});
  const auto seen_after = [&](const Rigid3& target_from_keyframe) {
    PatchQuery query;
    return predict_patch(rig, keyframe, 0, 5.0, 0, target_from_keyframe, keyframe.camera_view(0), &query);
  };
  EXPECT_TRUE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -1}}));
  // Behind, beside, and so near that even in the second octave the patch is more than 2.5 times larger.
  EXPECT_FALSE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -6}}));
  EXPECT_FALSE(seen_after({exp_so3({0, 1.2, 0}), {0, 0, 0}}));
  EXPECT_TRUE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -3.5}}));
  EXPECT_FALSE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -4.1}}));
}

// A blur that comes and goes leaves no octave in which both have features. How large patches are is compared
// in octaves that both have.
TEST(PredictPatch, ComparesASharpPictureWithASoftOne) {
  const TrackingRig rig(Rig{{test_camera()}});
  const Eigen::Vector2f pixel(320, 240);
  const KeyFrameView sharp = one_feature(rig, pixel),
                     soft = one_feature(rig, pixel, testing_support::soft_stripes(640, 480, 45, 8));
  ASSERT_EQ(sharp.octaves[0], 0);
  ASSERT_EQ(soft.octaves[0], 3);
  PatchQuery query;
  ASSERT_TRUE(predict_patch(rig, sharp, 0, 5.0, 0, Rigid3{}, soft.camera_view(0), &query));
  EXPECT_EQ(query.octave, 3);
  EXPECT_LT((query.keyframe_from_target - 8 * Eigen::Matrix2f::Identity()).norm(), 1e-4);
  ASSERT_TRUE(predict_patch(rig, soft, 0, 5.0, 0, Rigid3{}, sharp.camera_view(0), &query));
  EXPECT_EQ(query.octave, 3) << "to be aligned: corners are looked for in the first two";
  EXPECT_LT((query.keyframe_from_target - 8 * Eigen::Matrix2f::Identity()).norm(), 1e-4);
  // Not at any distance: three times as far from where it was seen, or as near.
  const auto along = [](double z) { return Rigid3{Eigen::Quaterniond::Identity(), {0, 0, z}}; };
  EXPECT_TRUE(predict_patch(rig, sharp, 0, 5.0, 0, along(5), soft.camera_view(0), &query));
  EXPECT_FALSE(predict_patch(rig, sharp, 0, 5.0, 0, along(10), soft.camera_view(0), &query));
  EXPECT_TRUE(predict_patch(rig, soft, 0, 5.0, 0, along(-2.5), sharp.camera_view(0), &query));
  EXPECT_FALSE(predict_patch(rig, soft, 0, 5.0, 0, along(-3.5), sharp.camera_view(0), &query));
}

}  // namespace
}  // namespace raysfm
