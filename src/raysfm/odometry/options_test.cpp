#include "raysfm/odometry/options.h"

#include <gtest/gtest.h>

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
}

TEST(OdometryOptions, TooSmallNumbersNameTheirFlag) {
  OdometryOptions options;
  options.features = 10;
  EXPECT_NE(validate(options).error().message.find("--features = 10"), std::string::npos);
  options = {};
  options.min_matches = 3;
  EXPECT_NE(validate(options).error().message.find("--min-matches = 3"), std::string::npos);
}

}  // namespace
}  // namespace raysfm
