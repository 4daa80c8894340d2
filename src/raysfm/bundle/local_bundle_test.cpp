#include "raysfm/bundle/local_bundle.h"

#include <gtest/gtest.h>

#include <climits>

namespace raysfm {
namespace {

TEST(LocalBundle, RefusesAWindowThatLeavesTheScaleFree) {
  EXPECT_TRUE(validate({}).ok());
  EXPECT_TRUE(validate({.free_cameras = 3, .window = 5}).ok());
  for (int window : {INT_MIN, 0, 3, 4}) {
    const Result<void> result = validate({.free_cameras = 3, .window = window});
    ASSERT_FALSE(result.ok());
    EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(result.error().message,
              "window: " + std::to_string(window) +
                  ": must be at least free-cameras + 2 = 5, or the frame and the scale at "
                  "the end of the sequence are free");
  }
  EXPECT_TRUE(validate({.free_cameras = 3, .window = 3, .may_free_scale = true}).ok());
  EXPECT_FALSE(validate({.free_cameras = 3, .window = 2, .may_free_scale = true}).ok());
  EXPECT_FALSE(validate({.free_cameras = 0}).ok());
  EXPECT_FALSE(validate({.free_cameras = INT_MAX, .window = INT_MAX}).ok());
  EXPECT_FALSE(validate({.global_until = -1}).ok());
}

TEST(LocalBundle, WindowOfThePaper) {
  const LocalBundleOptions options;  // n = 3, N = 10, N_f = 20
  const auto window = [&](int count) {
    const LocalWindow w = local_window(count, options);
    return std::pair(w.first_observed, w.first_free);
  };
  EXPECT_EQ(window(0), std::pair(0, 0));
  EXPECT_EQ(window(20), std::pair(0, 0));
  EXPECT_EQ(window(21), std::pair(11, 18));
  EXPECT_EQ(window(500), std::pair(490, 497));
  EXPECT_EQ(local_window(4, {.free_cameras = 3, .window = 10, .global_until = 0}).first_observed, 0);
  EXPECT_EQ(local_window(4, {.free_cameras = 3, .window = 10, .global_until = 0}).first_free, 1);
}

}  // namespace
}  // namespace raysfm
