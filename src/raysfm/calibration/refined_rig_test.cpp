#include "raysfm/calibration/refined_rig.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "raysfm/calibration/rig_parameters.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

// Two cameras of one make and one of another, none of them where another is.
Rig three_cameras() {
  Rig rig;
  for (int c = 0; c < 3; ++c) {
    Camera& camera = rig.cameras.emplace_back();
    camera.model = testing_support::fixtures<Radtan>()[0];
    camera.width = 640, camera.height = 480;
    const Eigen::Vector3d axis = Eigen::Vector3d(1, 2, 3).normalized();
    camera.rig_from_cam = {Eigen::Quaterniond(Eigen::AngleAxisd(0.4 * c, axis)), {0.5 * c, 0.1 * c, 0}};
  }
  rig.cameras[2].model = testing_support::fixtures<KannalaBrandt>()[0];
  return rig;
}

// Every number of a rig that was refined, as a report has them.
std::vector<CalibrationNumber> numbers_of(const RigParameters& parameters, const Rig& refined) {
  std::vector<CalibrationNumber> numbers;
  for (int c = 0; c < static_cast<int>(refined.cameras.size()); ++c) {
    std::set<std::string> seen;
    for (int i = 0; i < parameters.size(); ++i) {
      if (!parameters.concerns(i, c) || !seen.insert(parameters.name(i)).second) continue;
      numbers.push_back({c, parameters.name(i), parameters.number(i, c, parameters.given()),
                         parameters.number(i, c, refined)});
    }
  }
  return numbers;
}

double largest_difference(const Rig& a, const Rig& b) {
  double most = 0;
  for (size_t c = 0; c < a.cameras.size(); ++c) {
    const Rigid3 &pose_a = a.cameras[c].rig_from_cam, &pose_b = b.cameras[c].rig_from_cam;
    most = std::max(most, (pose_a.translation - pose_b.translation).norm());
    most = std::max(most, pose_a.rotation.angularDistance(pose_b.rotation));
    for (double x = 40; x < a.cameras[c].width; x += 80) {
      Ray ray_a, ray_b;
      EXPECT_TRUE(a.cameras[c].ray({x, 0.7 * x}, &ray_a) && b.cameras[c].ray({x, 0.7 * x}, &ray_b));
      most = std::max(most, (ray_a.direction - ray_b.direction).norm());
    }
  }
  return most;
}

void expect_taken_apart(const Rig& given, const RigParameters& parameters, const Eigen::VectorXd& values,
                        double most) {
  const Rig refined = parameters.rig(values);
  const RefinedRig found = refined_rig(refined, numbers_of(parameters, refined));
  EXPECT_GT(largest_difference(refined, given), 1e-5);
  EXPECT_LT(largest_difference(found.given, given), most);
  EXPECT_LT(largest_difference(RigParameters(found.given).rig(found.values), refined), most);
}

// Each number alone, of every camera; and all at once, where turns about several axes do not commute.
TEST(RefinedRig, TellsWhatWasGivenAndWhatWasMadeOfIt) {
  const Rig given = three_cameras();
  const RigParameters parameters(given);
  Eigen::VectorXd all = Eigen::VectorXd::Zero(parameters.size());
  for (int i = 0; i < parameters.size(); ++i) {
    const double change = 0.5 * parameters[i].prior_sigma;
    all[i] = i % 2 ? -change : change;
    SCOPED_TRACE(parameters.name(i));
    expect_taken_apart(given, parameters, change * Eigen::VectorXd::Unit(parameters.size(), i), 1e-9);
  }
  expect_taken_apart(given, parameters, all, 3e-4);
  EXPECT_EQ(largest_difference(refined_rig(given, {}).given, given), 0);
}

}  // namespace
}  // namespace raysfm
