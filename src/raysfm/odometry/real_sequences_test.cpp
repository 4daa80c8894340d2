// The pipeline on real images with surveyed poses.
#include <gtest/gtest.h>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/io/trajectory_file.h"
#include "raysfm/odometry/odometry.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::shared_data;

struct RealSequence {
  const char* folder;
  int frames;
  double max_percent;       // of the path: mean error of the positions
  double max_rotation_deg;  // rms over consecutive frames
};

class RealSequenceTest : public testing::TestWithParam<RealSequence> {};

TEST_P(RealSequenceTest, EveryFrameIsPosedNearTheTruth) {
  const RealSequence& sequence = GetParam();
  RAYSFM_SKIP_WITHOUT_SHARED_DATA(sequence.folder);
  Result<Input> input = open_input({shared_data(sequence.folder).string()}, {.mono = true});
  ASSERT_TRUE(input) << input.error().message;
  ASSERT_TRUE(input->calibration);
  const Result<Trajectory> truth = read_trajectory(shared_data(sequence.folder) / "truth.txt");
  ASSERT_TRUE(truth) << truth.error().message;

  Odometry odometry(Rig{{input->calibration->cameras[0]}}, {}, {});
  HarrisDetector detector;
  for (int i = 0; i < sequence.frames; ++i) {
    Result<std::optional<InputFrame>> frame = input->streams[0]->next();
    ASSERT_TRUE(frame) << frame.error().message;
    ASSERT_TRUE(frame->has_value()) << "frame " << i << " is missing";
    auto view = std::make_shared<View>();
    view->frame = i;
    view->timestamp = (*frame)->timestamp;
    view->cameras.resize(1);
    view->cameras[0].image = std::move((*frame)->gray);
    detect(detector, {}, &view->cameras[0]);
    odometry.process(view);
  }
  const Reconstruction r = odometry.finish(false);

  ASSERT_EQ(r.segments.size(), 1u);
  Trajectory estimate;
  for (const PosedFrame& f : r.frames) {
    ASSERT_TRUE(f.world_from_rig) << f.reason;
    estimate.timestamps.push_back(f.timestamp);
    estimate.world_from_cam.push_back(*f.world_from_rig);
  }
  const Result<Evaluation> error = evaluate(estimate, *truth, {});
  ASSERT_TRUE(error) << error.error().message;
  ASSERT_EQ(static_cast<int>(error->matches.size()), sequence.frames);
  RecordProperty("percent_of_path", std::to_string(error->percent_of_path()));
  RecordProperty("rotation_deg", std::to_string(error->rpe.rot_deg));
  EXPECT_LT(error->percent_of_path(), sequence.max_percent) << "of " << error->length << " m";
  EXPECT_LT(error->rpe.rot_deg, sequence.max_rotation_deg);
  EXPECT_LT(r.rms_reprojection_px, 1.0);
}

INSTANTIATE_TEST_SUITE_P(Real, RealSequenceTest,
                         testing::Values(RealSequence{"tsukuba-mono", 30, 1.0, 0.2},
                                         RealSequence{"kitti06-stereo", 30, 1.0, 0.2}),
                         [](const auto& info) {
                           std::string name = info.param.folder;
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace raysfm
