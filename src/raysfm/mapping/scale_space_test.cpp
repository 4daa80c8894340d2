// What one camera sees is the same in every octave: corners, patches, poses and their covariance.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "raysfm/core/median.h"
#include "raysfm/mapping/localiser.h"
#include "raysfm/matching/pair_tracker.h"
#include "support/pose_errors.h"
#include "support/true_map.h"

namespace raysfm {
namespace {

using testing_support::as_view;
using testing_support::crooked_rig;
using testing_support::film_enlarged;
using testing_support::PanelWorld;
using testing_support::pose_error;
using testing_support::render;
using testing_support::Texture;
using testing_support::true_map;
using testing_support::true_pose;
using testing_support::TrueMap;

constexpr int kWidth = 400, kHeight = 300;
const Eigen::Vector2d kCenter(200, 150);

// A wall before the camera, seen `scale` times as large as its texture about kCenter; what a pixel smaller
// than that of the texture cannot show is blurred away.
ViewPtr wall(const Texture& texture, double scale, const Eigen::Vector2d& shift = {0, 0}) {
  const Texture seen = scale < 1 ? texture.blurred(0.5 / scale) : texture;
  return as_view(render(seen, kWidth, kHeight,
                        [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
                          return kCenter + (p - shift - kCenter) / scale;
                        }),
                 0);
}

// The picture as taken by a camera of k times as many pixels.
ViewPtr enlarged_wall(const Texture& texture, int k) {
  const auto place = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return ((p.array() + 0.5) / k - 0.5).matrix();
  };
  return as_view(render(texture, kWidth * k, kHeight * k, place), 0);
}

TEST(ScaleSpace, CornersOfAnEnlargedPictureAreThoseOfTheOriginal) {
  const Texture texture(4, 6, 30, 40);
  const ViewPtr original = wall(texture, 1);
  const Features& corners = original->cameras[0].features;
  ASSERT_EQ(original->cameras[0].first_octave(), 0);
  for (const auto& [k, octave] : {std::pair(2, 1), {4, 2}}) {
    const ViewPtr enlarged = enlarged_wall(texture, k);
    const CameraView& large = enlarged->cameras[0];
    ASSERT_EQ(large.first_octave(), octave);
    int found = 0, strong = 0;
    std::vector<float> du, dv;
    for (int i = 0; i < corners.size(); ++i) {
      if (corners.octaves[i] != 0 || corners.scores[i] < 100) continue;
      ++strong;
      const Eigen::Vector2f expected = out_of_octave(corners.pixels[i], octave);
      large.grid(octave).for_each_in(expected, 0.5f * float(k), [&](int f) {
        ++found;
        EXPECT_EQ(large.features.octaves[f], octave);
        du.push_back((large.features.pixels[f] - expected).x() / float(k));
        dv.push_back((large.features.pixels[f] - expected).y() / float(k));
      });
    }
    EXPECT_GT(strong, 100);
    EXPECT_GT(found, 0.9 * strong) << k;
    EXPECT_NEAR(median_of(&du), 0, 0.02) << k;
    EXPECT_NEAR(median_of(&dv), 0, 0.02) << k;
  }
}

// Sizes at which nothing can be seen, or only in a strip.
TEST(ScaleSpace, DetectsInImagesOfAnySize) {
  for (const auto& [width, height] : {std::pair(1, 1), {2, 3}, {20, 20000}, {20000, 20}, {96, 95}}) {
    const ViewPtr view = as_view(testing_support::random_image(width, height, 1), 0);
    EXPECT_EQ(view->cameras[0].width, width);
    for (const Eigen::Vector2f& p : view->cameras[0].features.pixels) {
      EXPECT_TRUE(p.x() > 0 && p.x() < float(width) && p.y() > 0 && p.y() < float(height));
    }
  }
  EXPECT_EQ(testing_support::black_view(1, 1, 0)->cameras[0].features.size(), 0);
}

Camera wall_camera() {
  Camera camera;
  camera.model = Radtan::from_parameters({1000, 1000, kCenter.x(), kCenter.y(), 0, 0, 0, 0, 0});
  camera.width = kWidth;
  camera.height = kHeight;
  return camera;
}

struct Aligned {
  int queries = 0, converged = 0;
  std::vector<float> du, dv;  // errors, in pixels of the octave measured in
  std::array<int, 8> octaves{};
};

// Corners of the wall at scale 1, looked for where the camera sees it `scale` times as large.
Aligned align_at(double scale, uint8_t corner_octave) {
  const TrackingRig rig(Rig{{wall_camera()}});
  const Texture texture(4, 6, 30, 40);
  const ViewPtr source = wall(texture, 1), target = wall(texture, scale);
  const Features& corners = source->cameras[0].features;
  MapKeyFrame keyframe;
  for (int i = 0; i < corners.size(); ++i) keyframe.add(0, corners.pixels[i], corners.octaves[i], i);
  std::vector<KeyFrameView> views;
  views.push_back(make_keyframe_view(source, keyframe, rig));
  constexpr double kDepth = 10;
  const Rigid3 target_from_source{Eigen::Quaterniond::Identity(), {0, 0, kDepth / scale - kDepth}};
  std::vector<PatchQuery> queries;
  std::vector<Eigen::Vector2f> starts, expected;
  for (int f = 0; f < keyframe.size(); ++f) {
    const Eigen::Vector2d truth = kCenter + scale * (keyframe.pixels[f].cast<double>() - kCenter);
    const double reach = 16 * octave_side(2);
    if (corners.octaves[f] != corner_octave || truth.x() < reach || truth.y() < reach ||
        truth.x() > kWidth - reach || truth.y() > kHeight - reach) {
      continue;
    }
    PatchQuery query{.keyframe = 0, .feature = f};
    const double distance = kDepth / views[0].directions[f].z();
    if (!predict_patch(rig, views[0], f, distance, 0, target_from_source, target->cameras[0], &query))
      continue;
    queries.push_back(query);
    starts.push_back(truth.cast<float>() + Eigen::Vector2f(0.3f, -0.4f) * octave_side(query.octave));
    expected.push_back(truth.cast<float>());
  }
  std::vector<AlignedPatch> found;
  GuidedMatcher().align(views, queries, starts, *target, {}, &found);
  Aligned out;
  out.queries = static_cast<int>(queries.size());
  for (size_t i = 0; i < found.size(); ++i) {
    if (!found[i].converged) continue;
    ++out.converged;
    ++out.octaves[found[i].octave];
    const Eigen::Vector2f error = (found[i].pixel - expected[i]) / octave_side(found[i].octave);
    out.du.push_back(error.x());
    out.dv.push_back(error.y());
  }
  return out;
}

struct Zoom {
  double scale;
  uint8_t corner_octave;
  int octave;  // the finest that the target has
};

class PatchScaleTest : public testing::TestWithParam<Zoom> {};

TEST_P(PatchScaleTest, IsFoundInItsOctaveWithoutBias) {
  const Zoom zoom = GetParam();
  Aligned aligned = align_at(zoom.scale, zoom.corner_octave);
  ASSERT_GT(aligned.queries, 15);
  EXPECT_GT(aligned.converged, 0.85 * aligned.queries);
  EXPECT_GT(aligned.octaves[zoom.octave], 0.9 * aligned.converged);
  EXPECT_NEAR(median_of(&aligned.du), 0, 0.02);
  EXPECT_NEAR(median_of(&aligned.dv), 0, 0.02);
  for (std::vector<float>* errors : {&aligned.du, &aligned.dv}) {
    for (float& e : *errors) e = std::abs(e);
    EXPECT_LT(median_of(errors), 0.05);
  }
}

INSTANTIATE_TEST_SUITE_P(Scales, PatchScaleTest,
                         testing::Values(Zoom{1, 0, 0}, Zoom{1, 1, 0}, Zoom{2, 0, 1}, Zoom{2, 1, 1},
                                         Zoom{3, 0, 1}, Zoom{0.5, 0, 0}, Zoom{0.5, 1, 0},
                                         Zoom{1 / 3.0, 1, 0}),
                         [](const auto& info) {
                           const int percent = static_cast<int>(std::lround(100 * info.param.scale));
                           return "Corner" + std::to_string(info.param.corner_octave) + "At" +
                                  std::to_string(percent) + "Percent";
                         });

// delta with truth = retract(estimate, delta).
TEST(ScaleSpace, APoseIsAsExactFromAnEnlargedVideo) {
  const PanelWorld world(17);
  const OdometryOptions options;
  double sigma = 0, size = 0;  // of the video as taken
  for (const int k : {1, 2, 3, 4}) {
    const TrueMap truth = true_map(world, 2, 1, k);
    Localiser localiser(truth.rig, options);
    const LocalMap local = make_local_map(truth.map, truth.views, truth.rig, 1, 10);
    const Rigid3 pose = true_pose(truth.rig, 1.7);
    const ViewPtr view = film_enlarged(world, truth.rig.camera(0).rig_from_cam, pose, 3, k);
    Eigen::Matrix<double, 6, 1> off;
    off << 0.02, -0.01, 0.025, 0.008, -0.015, 0.01;
    const Localisation found = localiser.localise(truth.map, truth.views, local, *view, retract(pose, off),
                                                  {.radius_px = 15.0f * k, .coarse_points = 300});
    ASSERT_TRUE(found.ok) << k << ": " << found.reason;
    const double stated = found.covariance.diagonal().head<3>().cwiseSqrt().norm();
    if (k == 1) sigma = found.sigma_px, size = stated;
    EXPECT_LT(pose_error(pose, found.rig_from_world).head<3>().norm(), 0.004) << k;
    EXPECT_LT(pose_error(pose, found.rig_from_world).tail<3>().norm(), 0.001) << k;
    EXPECT_LT(stated, 2 * size) << k;
    EXPECT_GT(stated, 0.5 * size) << k;
    EXPECT_LT(found.sigma_px, 2 * sigma) << k;
  }
}

// The normalised squared error of a pose has mean 6 and standard deviation sqrt(12) where observations err by
// as much in pixels of their octaves, whatever these are.
TEST(ScaleSpace, CovarianceHoldsForMixedOctaves) {
  const TrackingRig rig = crooked_rig();
  const Camera& camera = rig.camera(0);
  const Rigid3 pose = true_pose(rig, 1);
  const Rigid3 cam_from_world = camera.rig_from_cam.inverse() * pose;
  const OdometryOptions options;
  Localiser localiser(rig, options);
  Rng rng(9);
  Map map;
  std::vector<TrackPixel> exact;
  for (int t = 0; t < 200; ++t) {
    const Eigen::Vector2d pixel(rng.uniform(10, 310), rng.uniform(10, 230));
    const Ray ray = testing_support::world_ray(camera, pose, pixel);
    map.tracks.push_back({ray.origin + rng.uniform(2, 8) * ray.direction, true, {}, {}});
    Eigen::Vector2d seen;
    ASSERT_TRUE(camera.project(cam_from_world * map.tracks[t].position, &seen));
    exact.push_back({t, 0, static_cast<uint8_t>(t % 4), seen.cast<float>()});
  }
  constexpr int kRuns = 300;
  double sum = 0;
  for (int run = 0; run < kRuns; ++run) {
    std::vector<TrackPixel> noisy = exact;
    for (TrackPixel& m : noisy) {
      m.pixel += 0.2f * octave_side(m.octave) * Eigen::Vector2f(float(rng.normal()), float(rng.normal()));
    }
    Rigid3 found = pose;
    Matrix6d covariance;
    ASSERT_TRUE(localiser.refine(map, noisy, &found, &covariance));
    const Eigen::Matrix<double, 6, 1> error = pose_error(pose, found);
    sum += error.dot(covariance.llt().solve(error));
  }
  EXPECT_NEAR(sum / kRuns, 6, 4 * std::sqrt(12.0 / kRuns));
}

// Corners of views of which one is out of focus, so that their first octaves differ.
TEST(ScaleSpace, CornersAreFollowedIntoAndOutOfABlur) {
  const Texture texture(4, 6, 60, 40);
  const Eigen::Vector2d shift(6.3, -3.8);
  const ViewPtr sharp = wall(texture, 1), blurred = wall(texture.blurred(3), 1, shift);
  const ViewPtr behind = wall(texture, 1, shift), soft = wall(texture.blurred(3), 1);
  ASSERT_EQ(sharp->cameras[0].first_octave(), 0);
  ASSERT_GE(blurred->cameras[0].first_octave(), 1);
  for (const auto& [base, next] : {std::pair(sharp, blurred), {soft, behind}}) {
    PairTracker tracker(base, 0);
    const int matched = tracker.advance(next);
    EXPECT_GT(matched, 25);
    int right = 0;
    for (int f = 0; f < tracker.base().features.size(); ++f) {
      const int m = tracker.matches(0)[f];
      if (m < 0) continue;
      const Features& found = next->cameras[0].features;
      const Eigen::Vector2f expected = tracker.base().features.pixels[f] + shift.cast<float>();
      right += (found.pixels[m] - expected).norm() < 1.5f * octave_side(found.octaves[m]);
    }
    EXPECT_GT(right, 0.8 * matched);
  }
}

}  // namespace
}  // namespace raysfm
