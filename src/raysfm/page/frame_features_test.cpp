#include "raysfm/page/frame_features.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "raysfm/camera/fit_ray_table.h"
#include "support/small_reconstruction.h"

namespace raysfm {
namespace {

using nlohmann::json;
using testing_support::small_reconstruction;

const Pinhole kLens{500, 510, 319.5, 239.5};

// Frames 0, 3, 6 and 9 are key frames, whose observations are exact projections; frame 5 has no pose.
TEST(FrameFeatures, AKeyFrameHasWhatItMatched) {
  const Reconstruction r = small_reconstruction({kLens, kLens});
  const json features = json::parse(FrameFeatures(r).json(3, 1));
  const KeyFrame& keyframe = r.keyframes[1];
  std::vector<Observation> matched;
  for (int k = keyframe.first_observation; k < keyframe.last_observation; ++k) {
    if (r.observations[k].camera == 1) matched.push_back(r.observations[k]);
  }
  ASSERT_GT(matched.size(), 10u);
  EXPECT_EQ(features["size"], json({640, 480}));
  EXPECT_EQ(features["seen"], matched.size());
  ASSERT_EQ(features["tracks"].size(), matched.size());
  for (size_t i = 0; i < matched.size(); ++i) {
    EXPECT_NEAR(features["tracks"][i][0].get<double>(), matched[i].pixel.x(), 0.051);
    EXPECT_NEAR(features["tracks"][i][1].get<double>(), matched[i].pixel.y(), 0.051);
  }
}

// By hand: K (R^T (X - c)).
TEST(FrameFeatures, OtherFramesHaveWhatIsExpectedAndWhereItWas) {
  const Reconstruction r = small_reconstruction({kLens});
  const json features = json::parse(FrameFeatures(r).json(4, 0));
  EXPECT_EQ(features["seen"], 0);
  ASSERT_GT(features["tracks"].size(), 10u);
  const auto pixel = [&](int frame, const MapPoint& point) {
    const Rigid3& pose = *r.frames[frame].world_from_rig;
    const Eigen::Vector3d x =
        pose.rotation.toRotationMatrix().transpose() * (point.position - pose.translation);
    return Eigen::Vector2d(500 * x.x() / x.z() + 319.5, 510 * x.y() / x.z() + 239.5);
  };
  const json& track = features["tracks"][0];
  int which = -1;
  for (size_t p = 0; p < r.points.size(); ++p) {
    const Eigen::Vector2d at = pixel(4, r.points[p]);
    if (std::abs(at.x() - track[0].get<double>()) < 0.06 &&
        std::abs(at.y() - track[1].get<double>()) < 0.06) {
      which = static_cast<int>(p);
    }
  }
  ASSERT_GE(which, 0);
  ASSERT_GE(track.size(), 4u);
  EXPECT_NEAR(track[2].get<double>(), pixel(3, r.points[which]).x(), 0.06);
  EXPECT_NEAR(track[3].get<double>(), pixel(3, r.points[which]).y(), 0.06);
  // Frame 5 has no pose: tracks of frame 6 do not reach behind it.
  for (const json& t : json::parse(FrameFeatures(r).json(6, 0))["tracks"]) EXPECT_EQ(t.size(), 2u);
}

// The rays of the same lens, without its formula.
TEST(FrameFeatures, CamerasThatCannotProjectHaveWhatIsExpectedToo) {
  Reconstruction r = small_reconstruction({kLens});
  const json expected = json::parse(FrameFeatures(r).json(4, 0))["tracks"];
  const Result<RayFit> fit = fit_ray_table(r.rig.cameras[0]);
  ASSERT_TRUE(fit.ok());
  r.rig.cameras[0].model = fit->camera.model;
  Eigen::Vector2d pixel;
  ASSERT_FALSE(r.rig.cameras[0].project({0, 0, 1}, &pixel));
  const json found = json::parse(FrameFeatures(r).json(4, 0))["tracks"];
  ASSERT_EQ(found.size(), expected.size());
  for (size_t t = 0; t < found.size(); ++t) {
    ASSERT_EQ(found[t].size(), expected[t].size());
    for (size_t k = 0; k < found[t].size(); ++k) {
      EXPECT_NEAR(found[t][k].get<double>(), expected[t][k].get<double>(), 0.11);
    }
  }
}

TEST(FrameFeatures, NothingWhereThereIsNothing) {
  const Reconstruction r = small_reconstruction({kLens});
  const FrameFeatures features(r);
  for (const auto& [frame, camera] :
       {std::pair(5, 0), std::pair(-1, 0), std::pair(12, 0), std::pair(3, 1), std::pair(3, -1)}) {
    EXPECT_TRUE(json::parse(features.json(frame, camera))["tracks"].empty()) << frame << " " << camera;
  }
}

}  // namespace
}  // namespace raysfm
