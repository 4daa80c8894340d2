#include "raysfm/optim/work_team.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace raysfm {
namespace {

TEST(WorkTeam, EveryPassRunsOnce) {
  for (int threads : {1, 2, 5}) {
    WorkTeam team(threads);
    EXPECT_EQ(team.threads(), threads);
    for (int count : {0, 1, 2, 3, 100, 1000}) {
      std::vector<int> runs(count, 0);
      for (int repeat = 0; repeat < 20; ++repeat) team.run(count, [&](int i) { ++runs[i]; });
      for (int r : runs) ASSERT_EQ(r, 20);
    }
  }
}

TEST(WorkTeam, AllHasRunWhenItReturns) {
  WorkTeam team(3);
  for (int loop = 0; loop < 2000; ++loop) {
    std::atomic<int> sum = 0;
    team.run(7, [&](int i) { sum += i; });
    ASSERT_EQ(sum, 21);
  }
}

}  // namespace
}  // namespace raysfm
