// The evaluation on real trajectories against results that others published for them.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/results/trajectory_file.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::shared_data;

Trajectory read_ok(const std::string& name) {
  const Result<Trajectory> trajectory = read_trajectory(shared_data("eval/trajectories") / name);
  if (!trajectory) ADD_FAILURE() << trajectory.error().message;
  return trajectory ? *trajectory : Trajectory{};
}

// Results of evo that come with its test data: APE of the translation after SE(3) alignment, and RPE over
// consecutive stretches of 10 m of the estimated path.
struct EvoResult {
  const char* estimate;
  double ape_rmse, ape_mean, ape_median, ape_max;
  double rpe_rmse;
  size_t rpe_pairs;
};

const EvoResult kEvoResults[] = {
    {"KITTI_00_ORB.txt", 1.3034497145650266, 1.1569971285389768, 1.065624769555848, 3.587949120678954,
     0.22626134329310163, 353},
    {"KITTI_00_SPTAM.txt", 3.738487907582613, 3.4909766330848684, 3.6425846417432637, 7.7689774065713175,
     0.27607109043606004, 355},
};

// evo's stretches: each ends at the first pose at least `length` behind the end of the one before; the first
// stretch is left out.
std::vector<PosePair> pairs_by_path(const std::vector<Rigid3>& poses, double length) {
  std::vector<int> ends;
  double path = 0;
  for (int i = 1; i < static_cast<int>(poses.size()); ++i) {
    path += (poses[i].translation - poses[i - 1].translation).norm();
    if (path < length) continue;
    ends.push_back(i);
    path = 0;
  }
  std::vector<PosePair> pairs;
  for (size_t i = 1; i < ends.size(); ++i) pairs.push_back({ends[i - 1], ends[i]});
  return pairs;
}

TEST(EvaluationOnData, AgreesWithEvo) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("eval/trajectories");
  const Trajectory truth = read_ok("KITTI_00_gt.txt");
  for (const EvoResult& expected : kEvoResults) {
    SCOPED_TRACE(expected.estimate);
    const Trajectory estimate = read_ok(expected.estimate);
    const Result<Evaluation> e = evaluate(estimate, truth, {Alignment::kSe3, 0.01});
    ASSERT_TRUE(e.ok()) << e.error().message;
    EXPECT_EQ(e->coverage, 1.0);
    EXPECT_NEAR(e->ate.rmse, expected.ape_rmse, 1e-6);
    EXPECT_NEAR(e->ate.mean, expected.ape_mean, 1e-6);
    EXPECT_NEAR(e->ate.median, expected.ape_median, 1e-6);
    EXPECT_NEAR(e->ate.max, expected.ape_max, 1e-6);

    const std::vector<PosePair> pairs = pairs_by_path(estimate.world_from_cam, 10.0);
    EXPECT_EQ(pairs.size(), expected.rpe_pairs);
    const RelativeError rpe = relative_error(estimate.world_from_cam, truth.world_from_cam, pairs);
    EXPECT_NEAR(rpe.trans, expected.rpe_rmse, 1e-5);
  }
}

// ORB-SLAM2 (Mur-Artal and Tardos 2017, Table I) reports 0.70 % and 0.25 deg / 100 m for KITTI 00; the
// trajectory is of that system, of another run.
TEST(EvaluationOnData, DriftIsWhatThePublicationSays) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("eval/trajectories");
  const Result<Evaluation> e =
      evaluate(read_ok("KITTI_00_ORB.txt"), read_ok("KITTI_00_gt.txt"), {Alignment::kNone, 0.01});
  ASSERT_TRUE(e.ok());
  ASSERT_TRUE(e->kitti.has_value());
  EXPECT_NEAR(e->kitti->t_rel_percent, 0.70, 0.05);
  EXPECT_NEAR(e->kitti->r_rel_deg_per_100m, 0.25, 0.03);
  EXPECT_NEAR(e->length, 3724, 1);  // length of KITTI 00
}

TEST(EvaluationOnData, MonocularKeyFramesOfADenserTruth) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("eval/trajectories");
  const Result<Evaluation> e = evaluate(read_ok("freiburg1_xyz-ORB_kf_mono.txt"),
                                        read_ok("freiburg1_xyz-groundtruth.txt"), {Alignment::kSim3, 0.01});
  ASSERT_TRUE(e.ok()) << e.error().message;
  EXPECT_EQ(e->matches.size(), 32u);
  EXPECT_LT(e->ate.rmse, 0.02);  // metres; the system is good to about 1 cm on this sequence
}

}  // namespace
}  // namespace raysfm
