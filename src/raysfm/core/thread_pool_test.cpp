#include "raysfm/core/thread_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace raysfm {
namespace {

class ThreadPoolTest : public testing::TestWithParam<int> {};

TEST_P(ThreadPoolTest, ParallelForVisitsEveryIndexOnce) {
  ThreadPool pool(GetParam());
  for (const int count : {0, 1, 2, 1000}) {
    std::vector<std::atomic<int>> visits(count);
    pool.parallel_for(count, [&](int i) { ++visits[i]; });
    for (const auto& v : visits) EXPECT_EQ(v, 1);
  }
}

TEST_P(ThreadPoolTest, SubmittedWorkRunsInOrderOfNeedAndReturnsItsValue) {
  ThreadPool pool(GetParam());
  std::vector<std::future<int>> futures;
  for (int i = 0; i < 50; ++i) futures.push_back(pool.submit([i] { return i * i; }));
  for (int i = 0; i < 50; ++i) EXPECT_EQ(futures[i].get(), i * i);
}

TEST_P(ThreadPoolTest, DestructionFinishesQueuedWork) {
  std::atomic<int> done = 0;
  {
    ThreadPool pool(GetParam());
    for (int i = 0; i < 20; ++i) pool.submit([&] { ++done; });
  }
  EXPECT_EQ(done, 20);
}

INSTANTIATE_TEST_SUITE_P(Workers, ThreadPoolTest, testing::Values(0, 1, 3));

}  // namespace
}  // namespace raysfm
