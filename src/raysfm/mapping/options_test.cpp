#include "raysfm/mapping/options.h"

#include <gtest/gtest.h>

#include <limits>

namespace raysfm {
namespace {

TEST(OdometryOptions, DefaultsAreValid) {
  EXPECT_TRUE(validate(OdometryOptions{}).ok());
}

TEST(OdometryOptions, AWindowThatLeavesTheScaleFreeIsRefusedWithTheReason) {
  OdometryOptions options;
  for (const int window : {3, 4}) {
    options.window = window;  // N = n, N = n + 1 (LBA09, tables 4 and 5)
    const auto result = validate(options);
    ASSERT_FALSE(result.ok());
    EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(result.error().message.find("scale"), std::string::npos) << result.error().message;
  }
  options.window = 5;
  EXPECT_TRUE(validate(options).ok());
  options.window = 3;
  options.paper_window = true;  // asked for, to see it fail
  EXPECT_TRUE(validate(options).ok());
}

TEST(OdometryOptions, PlainAnglesDoNotRefineTheLens) {
  OdometryOptions options;
  options.error = ErrorMeasure::kAngularPlain;
  EXPECT_TRUE(validate(options).ok());
  options.refine_lens = LensRefinement::kOn;
  EXPECT_NE(validate(options).error().message.find("--refine-lens = on"), std::string::npos);
  options.error = ErrorMeasure::kAngular;
  EXPECT_TRUE(validate(options).ok());
}

TEST(OdometryOptions, TooSmallNumbersNameTheirFlag) {
  OdometryOptions options;
  options.features = 10;
  EXPECT_NE(validate(options).error().message.find("--features = 10"), std::string::npos);
  options = {};
  options.min_matches = 3;
  EXPECT_NE(validate(options).error().message.find("--min-matches = 3"), std::string::npos);
}

TEST(OdometryOptions, BoundsAreWhatTheyAreSaidToBe) {
  const auto is_valid = [](int OdometryOptions::*field, int value) {
    OdometryOptions options;
    options.*field = value;
    return validate(options).ok();
  };
  EXPECT_FALSE(is_valid(&OdometryOptions::features, 49));
  EXPECT_TRUE(is_valid(&OdometryOptions::features, 50));
  EXPECT_TRUE(is_valid(&OdometryOptions::features, 100000));
  EXPECT_FALSE(is_valid(&OdometryOptions::features, 100001));
  EXPECT_FALSE(is_valid(&OdometryOptions::features, std::numeric_limits<int>::max()));
  EXPECT_FALSE(is_valid(&OdometryOptions::min_matches, 29));
  EXPECT_TRUE(is_valid(&OdometryOptions::min_matches, 30));
  EXPECT_FALSE(is_valid(&OdometryOptions::global_until, 2));
  EXPECT_TRUE(is_valid(&OdometryOptions::global_until, 3));
  EXPECT_FALSE(is_valid(&OdometryOptions::free_cameras, 0));
  // Free key frames beyond the window, also where their number and two more are no int.
  EXPECT_FALSE(is_valid(&OdometryOptions::free_cameras, std::numeric_limits<int>::max()));
  EXPECT_TRUE(is_valid(&OdometryOptions::window, std::numeric_limits<int>::max()));
}

TEST(Departures, ThoseNamedAreLeftOut) {
  Departures some;
  ASSERT_TRUE(leave_out("", &some));
  EXPECT_TRUE(some.blur && some.earlier && some.keyframes && some.noise && some.parallax && some.surfaces &&
              some.turning);
  ASSERT_TRUE(leave_out("keyframes,noise,turning", &some));
  EXPECT_TRUE(some.blur && some.earlier && some.parallax && some.surfaces);
  EXPECT_FALSE(some.keyframes || some.noise || some.turning);
  for (const char* names : {"blurr", "blur,,parallax", "blur parallax"}) {
    const Result<void> refused = leave_out(names, &some);
    ASSERT_FALSE(refused) << names;
    EXPECT_NE(refused.error().message.find("blur, earlier, keyframes"), std::string::npos);
  }
}

}  // namespace
}  // namespace raysfm
