#include "raysfm/calibration/calibration_choice.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

Rig pinhole_rig() {
  Camera camera;
  camera.model = Pinhole{500, 500, 319.5, 239.5};
  camera.width = 640, camera.height = 480;
  return {{camera}};
}

enum Unknown { kFocal, kAspect, kCx, kCy, kK1, kK2 };

// Evidence of independent observations of 1 standard deviation for a calibration, told within `sigma` of each
// number: infinite where it tells nothing.
CalibrationEvidence evidence_for(const Eigen::VectorXd& truth, const Eigen::VectorXd& sigma) {
  CalibrationEvidence e = CalibrationEvidence::nothing(Eigen::VectorXd::Zero(truth.size()));
  e.information = sigma.array().square().inverse().matrix().asDiagonal();
  e.gradient = -e.information * truth;
  e.scatter = e.information;
  e.observations = 10000;
  e.cost = 0.5 * 2 * e.observations;
  return e;
}

struct ChoiceTest : testing::Test {
  RigParameters parameters{pinhole_rig()};
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(6), sigma = Eigen::VectorXd::Constant(6, INFINITY);
  CalibrationChoice choice() const { return choose_calibration(parameters, evidence_for(truth, sigma)); }
};

TEST_F(ChoiceTest, OrderOfUnknownsIsAsTheTestsHaveIt) {
  const char* const names[] = {"fx", "fy", "cx", "cy", "k1", "k2"};
  ASSERT_EQ(parameters.size(), 6);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(parameters.name(i), names[i]);
}

TEST_F(ChoiceTest, TakesWhatIsToldAndOff) {
  truth[kK1] = 0.02;
  sigma[kK1] = 0.001;
  EXPECT_NEAR(choice().values[kK1], 0.02, 1e-4);
  EXPECT_TRUE(choice().is_told[kK1]);
  EXPECT_FALSE(choice().is_told[kFocal]);
  EXPECT_EQ(choice().values[kFocal], 0);
  // The covariance of the gradient and the scatter of residuals count alike: twice the variance.
  EXPECT_NEAR(choice().sigma[kK1], std::sqrt(2) * 0.001, 1e-5);
  EXPECT_NEAR(choice().covariance(kK1, kK1), 2e-6, 2e-8);
  EXPECT_EQ(choice().covariance(kFocal, kFocal), 0) << "what is not told";
  EXPECT_TRUE(is_worth_it(choice()));
}

// At once, for a rig of many cameras too.
TEST_F(ChoiceTest, NothingObservedTellsNothing) {
  Rig many = pinhole_rig();
  many.cameras.resize(64, many.cameras[0]);
  const RigParameters unknowns(many);
  const CalibrationEvidence none = CalibrationEvidence::nothing(Eigen::VectorXd::Zero(unknowns.size()));
  const CalibrationChoice found = choose_calibration(unknowns, none);
  EXPECT_TRUE(found.values.isZero(0));
  EXPECT_EQ(found.effect, 0);
  for (int i = 0; i < unknowns.size(); ++i) {
    EXPECT_FALSE(found.is_told[i]);
    EXPECT_EQ(found.sigma[i], unknowns[i].prior_sigma);
  }
}

TEST_F(ChoiceTest, KeepsWhatIsOffByNoMoreThanItsErrors) {
  sigma[kK1] = 0.001;
  truth[kK1] = 3.5 * std::sqrt(2) * 0.001;
  EXPECT_TRUE(choice().is_told[kK1]);
  EXPECT_EQ(choice().values[kK1], 0);
  EXPECT_NEAR(choice().significance[kK1], 3.5, 0.01);
  EXPECT_NEAR(choice().likeliest[kK1], truth[kK1], 0.01 * truth[kK1]);
  EXPECT_EQ(choice().likeliest[kFocal], 0);
  EXPECT_FALSE(is_worth_it(choice()));
  truth[kK1] = 4.5 * std::sqrt(2) * 0.001;
  EXPECT_NEAR(choice().values[kK1], truth[kK1], 0.01 * truth[kK1]);
}

// What is not told stays, even where it goes together with what is.
TEST_F(ChoiceTest, WhatIsNotToldStaysAsGiven) {
  CalibrationEvidence e = CalibrationEvidence::nothing(Eigen::VectorXd::Zero(6));
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(6);  // only this sum is seen
  direction[kFocal] = 1, direction[kK1] = 1;
  e.information = 1e8 * direction * direction.transpose();
  e.gradient = -e.information * (0.02 * Eigen::VectorXd::Unit(6, kK1));
  e.scatter = e.information;
  e.observations = 10000;
  e.cost = e.observations;
  const CalibrationChoice c = choose_calibration(parameters, e);
  const int told = c.is_told[kFocal] + c.is_told[kK1];
  EXPECT_EQ(told, 1);  // one of them is held, and what the sum says goes to the other
  EXPECT_NEAR(c.values[kFocal] + c.values[kK1], 0.02, 1e-3);
}

// Errors that go together in clusters: the scatter is larger than the information says.
TEST_F(ChoiceTest, ErrorsThatGoTogetherCount) {
  sigma[kK1] = 0.001;
  truth[kK1] = 0.01;
  CalibrationEvidence e = evidence_for(truth, sigma);
  EXPECT_NE(choose_calibration(parameters, e).values[kK1], 0);
  e.scatter *= 25;
  EXPECT_EQ(choose_calibration(parameters, e).values[kK1], 0);
}

// One that was changed before takes two standard deviations to stay changed, not four.
TEST_F(ChoiceTest, WhatWasChangedBeforeStaysChanged) {
  constexpr double kSigma = 0.001 * M_SQRT2;
  sigma[kK1] = 0.001;
  const auto found_for = [&](double k1) {
    truth[kK1] = k1;
    CalibrationEvidence e = evidence_for(truth, sigma);
    e.at[kK1] = 0.01;
    e.gradient += e.information * e.at;
    return choose_calibration(parameters, e).values[kK1];
  };
  EXPECT_NEAR(found_for(3 * kSigma), 3 * kSigma, 0.03 * kSigma);
  EXPECT_EQ(found_for(1.5 * kSigma), 0);
}

// However sure: patches are not found so well.
TEST_F(ChoiceTest, AChangeThatMovesNextToNothingIsNotWorthIt) {
  sigma[kK1] = 1e-6;
  truth[kK1] = 1e-5;  // ten standard deviations
  CalibrationEvidence e = evidence_for(truth, sigma);
  e.observations = 10000000, e.cost = e.observations;
  EXPECT_FALSE(is_worth_it(choose_calibration(parameters, e)));
}

// A focal length and distortion that explain about the same: where one does not surely explain more, either
// is as likely, and both are changed, whichever was before.
TEST_F(ChoiceTest, OfTwoExplanationsThatAreAsGoodBothAreTaken) {
  const double f = parameters[kFocal].prior_sigma, k1 = parameters[kK1].prior_sigma;
  // `focal_part` of what is off is the focal length's, in standard deviations of the priors.
  const auto found_for = [&](double focal_part, const Eigen::VectorXd& before) {
    constexpr double kObservations = 4000, kAlike = 0.99;
    CalibrationEvidence e = evidence_for(truth, sigma);
    e.information(kFocal, kFocal) = kObservations / (f * f);
    e.information(kK1, kK1) = kObservations / (k1 * k1);
    e.information(kFocal, kK1) = e.information(kK1, kFocal) = kAlike * kObservations / (f * k1);
    e.scatter = e.information;
    e.at = before;
    Eigen::VectorXd off = Eigen::VectorXd::Zero(6);
    off[kFocal] = focal_part * f, off[kK1] = (1 - focal_part) * k1;
    e.gradient = e.information * (e.at - off);
    const CalibrationChoice found = choose_calibration(parameters, e);
    return Eigen::Vector2d(found.values[kFocal] / f, found.values[kK1] / k1);
  };
  const Eigen::VectorXd nothing = Eigen::VectorXd::Zero(6);
  Eigen::VectorXd focal = nothing, distortion = nothing;
  focal[kFocal] = f, distortion[kK1] = k1;
  // One alone is a little better than the other: 0.99 of 0.45 would go to the focal length.
  for (const Eigen::VectorXd& before : {nothing, focal, distortion}) {
    const Eigen::Vector2d found = found_for(0.55, before);
    EXPECT_NEAR(found[0], 0.55, 0.02);
    EXPECT_NEAR(found[1], 0.45, 0.02);
  }
  for (const Eigen::VectorXd& before : {nothing, focal, distortion}) {
    EXPECT_NEAR(found_for(1, before)[0], 1, 0.01);
    EXPECT_EQ(found_for(1, before)[1], 0);
    EXPECT_NEAR(found_for(0, before)[1], 1, 0.01);
    EXPECT_EQ(found_for(0, before)[0], 0);
  }
}

// A principal point and a camera that is turned explain about the same too, but what is not told of a lens is
// not put on the rig.
TEST(Choice, WhatALensMayBeOffByLeavesTheRigAsItIs) {
  Rig rig = pinhole_rig();
  rig.cameras.push_back(rig.cameras[0]);
  rig.cameras[1].model = Pinhole{800, 800, 319.5, 239.5};
  rig.cameras[1].rig_from_cam.translation.x() = 0.1;
  const RigParameters parameters(rig);
  const auto find = [&](RigParameters::Kind kind, int index) {
    int i = 0;
    while (parameters[i].camera != 1 || parameters[i].kind != kind || parameters[i].index != index) ++i;
    return i;
  };
  const int turn = find(RigParameters::Kind::kTurn, 1), cx = find(RigParameters::Kind::kNumber, 2);
  ASSERT_EQ(parameters.name(cx), "cx");
  const double a = parameters[cx].prior_sigma, b = parameters[turn].prior_sigma;
  constexpr double kObservations = 4000, kAlike = 0.99;
  CalibrationEvidence e = CalibrationEvidence::nothing(Eigen::VectorXd::Zero(parameters.size()));
  e.information(cx, cx) = kObservations / (a * a);
  e.information(turn, turn) = kObservations / (b * b);
  e.information(cx, turn) = e.information(turn, cx) = kAlike * kObservations / (a * b);
  e.scatter = e.information;
  e.observations = 10000, e.cost = e.observations;
  Eigen::VectorXd off = Eigen::VectorXd::Zero(parameters.size());
  off[cx] = 0.55 * a, off[turn] = 0.45 * b;
  e.gradient = -e.information * off;
  const CalibrationChoice found = choose_calibration(parameters, e);
  EXPECT_NEAR(found.values[cx], (0.55 + kAlike * 0.45) * a, 0.01 * a);
  EXPECT_EQ(found.values[turn], 0);
}

// The same where errors go together in what tells the distortion: neither is more likely for being told by
// less of them.
TEST_F(ChoiceTest, ComparesExplanationsByTheSameEvidence) {
  const double f = parameters[kFocal].prior_sigma, k1 = parameters[kK1].prior_sigma;
  constexpr double kObservations = 4000, kAlike = 0.9, kTogether = 4;
  CalibrationEvidence e = evidence_for(truth, sigma);
  e.information(kFocal, kFocal) = kObservations / (f * f);
  e.information(kK1, kK1) = kObservations / (k1 * k1);
  e.information(kFocal, kK1) = e.information(kK1, kFocal) = kAlike * kObservations / (f * k1);
  e.scatter(kFocal, kFocal) = kObservations / (f * f);
  e.scatter(kK1, kK1) = kTogether * kObservations / (k1 * k1);
  e.at[kK1] = k1;
  Eigen::VectorXd off = Eigen::VectorXd::Zero(6);
  off[kFocal] = 0.5 * f, off[kK1] = 0.5 * k1;
  e.gradient = e.information * (e.at - off);
  const CalibrationChoice found = choose_calibration(parameters, e);
  EXPECT_NEAR(found.values[kFocal], off[kFocal], 0.05 * f);
  EXPECT_NEAR(found.values[kK1], off[kK1], 0.05 * k1);
}

// What looks like a readout along the longer side, upwards, or like a very short one, is more likely
// something else.
TEST_F(ChoiceTest, AReadoutMustBeLikely) {
  const auto finds = [](int width, int height, int readout, double standard_deviations,
                        double seconds = 0.015) {
    Rig rig = pinhole_rig();
    rig.cameras[0].width = width, rig.cameras[0].height = height;
    const RigParameters unknowns(rig, 1, {.readout = 0.02});
    const int i = unknowns.size() - 2 + readout;
    Eigen::VectorXd truth = Eigen::VectorXd::Zero(unknowns.size());
    Eigen::VectorXd sigma = Eigen::VectorXd::Constant(unknowns.size(), INFINITY);
    truth[i] = seconds;
    sigma[i] = std::abs(seconds) / standard_deviations / std::sqrt(2);  // beside the scatter of residuals
    CalibrationEvidence evidence = evidence_for(truth, sigma);
    evidence.lens_scatter = evidence.scatter;
    return choose_calibration(unknowns, evidence, 0.04).values[i] != 0;
  };
  constexpr int kDown = 0, kRight = 1;
  EXPECT_TRUE(finds(640, 480, kDown, 6));
  EXPECT_FALSE(finds(640, 480, kRight, 6));
  EXPECT_TRUE(finds(640, 480, kRight, 10));
  EXPECT_FALSE(finds(480, 640, kDown, 6));
  EXPECT_TRUE(finds(480, 640, kRight, 6));
  EXPECT_TRUE(finds(480, 480, kDown, 6));
  EXPECT_TRUE(finds(480, 480, kRight, 6));
  EXPECT_FALSE(finds(640, 480, kDown, 6, -0.015));
  EXPECT_TRUE(finds(640, 480, kDown, 10, -0.015));
  EXPECT_TRUE(finds(480, 640, kRight, 6, -0.015)) << "a phone held upright";
  // Nor is there one of a sensor that is faster than any.
  EXPECT_FALSE(finds(640, 480, kDown, 6, 0.0025));
  EXPECT_TRUE(finds(640, 480, kDown, 6, 0.004));
  // Nor of one that is slower than it can be.
  EXPECT_TRUE(finds(640, 480, kDown, 20, 0.039));
  EXPECT_FALSE(finds(640, 480, kDown, 20, 0.041));
}

// Of a lens that was known to 2 %, and a map that tells a readout and, to a part of `sigma`, another focal
// length and height of the principal point, neither of which is significantly off.
CalibrationChoice choice_of_bent_lens(bool without_shutter, double sigma) {
  const RigParameters unknowns(
      pinhole_rig(), 1,
      {.focal = 0.02, .centre = 0.002, .readout = 0.02, .without_shutter = without_shutter});
  const int readout = unknowns.size() - 2;
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(unknowns.size());
  Eigen::VectorXd deviation = Eigen::VectorXd::Constant(unknowns.size(), INFINITY);
  truth[kFocal] = -0.05, truth[kCy] = 15, truth[readout] = 0.03;
  deviation[kFocal] = sigma, deviation[kCy] = 300 * sigma, deviation[readout] = 0.001;
  CalibrationEvidence evidence = evidence_for(truth, deviation);
  evidence.lens_scatter = evidence.scatter;
  return choose_calibration(unknowns, evidence);
}

TEST_F(ChoiceTest, ALensFoundWithoutAShutterIsFoundAnewWhereOneRolls) {
  constexpr double kSurer = 0.012, kVaguer = 0.02;
  const CalibrationChoice found = choice_of_bent_lens(true, kSurer);
  EXPECT_NEAR(found.values[kFocal], -0.05, 0.005);
  EXPECT_NEAR(found.values[kCy], 15, 2);
  // Not where the map tells it less well than it was known, nor a lens that was calibrated.
  for (const CalibrationChoice& kept :
       {choice_of_bent_lens(true, kVaguer), choice_of_bent_lens(false, kSurer)}) {
    EXPECT_EQ(kept.values[kFocal], 0);
    EXPECT_EQ(kept.values[kCy], 0);
    EXPECT_NEAR(kept.values[kept.values.size() - 2], 0.03, 0.001);
  }
}

// Pixels are square or, of squeezed images, anything: 4 % off is found as it is, 0.5 % is held back.
TEST_F(ChoiceTest, SqueezedImagesAreNoticed) {
  sigma[kAspect] = 0.005;
  truth[kAspect] = 0.04;
  EXPECT_NEAR(choice().values[kAspect], 0.04, 0.002);
  EXPECT_FALSE(choice().contradicts);
  sigma[kAspect] = 0.0008;
  truth[kAspect] = 0.005;
  EXPECT_LT(choice().values[kAspect], 0.004);
}

TEST_F(ChoiceTest, OfAGuessAllThatIsToldIsTaken) {
  sigma[kK1] = 0.001;
  truth[kK1] = 2 * std::sqrt(2) * 0.001;
  EXPECT_EQ(choice().values[kK1], 0);
  const CalibrationChoice all = choose_calibration(parameters, evidence_for(truth, sigma), 1, true);
  EXPECT_NEAR(all.values[kK1], truth[kK1], 0.01 * truth[kK1]);
  EXPECT_EQ(all.values[kFocal], 0);
}

TEST_F(ChoiceTest, WhatIsLikelierIsWhatIsToldHoweverLittleItIsOff) {
  truth[kK1] = 0.002;
  sigma[kK1] = 0.001;
  CalibrationEvidence evidence = evidence_for(truth, sigma);
  evidence.at[kCx] = 3;
  EXPECT_EQ(choice().values[kK1], 0) << "not surely off";
  const auto values = likelier(parameters, evidence, 0);
  ASSERT_TRUE(values);
  EXPECT_NEAR((*values)[kK1], 0.002, 1e-4);
  EXPECT_EQ((*values)[kCx], 3) << "it is not told";
  evidence.at[kK1] = 0.002;
  evidence.gradient.setZero();
  EXPECT_FALSE(likelier(parameters, evidence, 0)) << "there already";
}

TEST_F(ChoiceTest, AFocalLengthThatIsFarIsReachedInSteps) {
  const Eigen::VectorXd here = Eigen::VectorXd::Zero(6);
  sigma[kFocal] = 0.003;
  sigma[kK1] = 0.001;
  truth[kFocal] = 0.25;
  truth[kK1] = -0.02;
  const CalibrationChoice near = within_reach(parameters, here, choice());
  EXPECT_EQ(near.values, choice().values);
  EXPECT_FALSE(near.is_part);
  truth[kFocal] = -0.6;
  const CalibrationChoice part = within_reach(parameters, here, choice());
  EXPECT_TRUE(part.is_part);
  EXPECT_NEAR(part.values[kFocal], -0.3, 1e-9);
  EXPECT_NEAR(part.values[kK1] / choice().values[kK1], 0.5, 0.01);
  EXPECT_NEAR(part.effect / choice().effect, 0.5, 0.01);
}

TEST_F(ChoiceTest, AnotherLensIsNoticed) {
  sigma[kFocal] = 0.003;
  truth[kFocal] = 0.05;
  EXPECT_FALSE(choice().contradicts);
  EXPECT_NEAR(choice().values[kFocal], 0.05, 0.003);
  truth[kFocal] = -0.3;
  EXPECT_TRUE(choice().contradicts);
  EXPECT_NEAR(choice().values[kFocal], -0.3, 0.003);
}

}  // namespace
}  // namespace raysfm
