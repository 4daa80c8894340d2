#include "raysfm/core/thread_pool.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <mutex>
#include <new>
#include <thread>
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

// What is submitted first is begun first. A worker may be held up between taking its work and beginning it,
// so that work comes earlier by the number of the other workers at most.
TEST_P(ThreadPoolTest, SubmittedWorkBeginsInOrderAndReturnsItsValue) {
  ThreadPool pool(GetParam());
  std::mutex mutex;
  std::vector<int> begun;
  std::vector<std::future<int>> futures;
  for (int i = 0; i < 200; ++i) {
    futures.push_back(pool.submit([&, i] {
      const std::lock_guard lock(mutex);
      begun.push_back(i);
      return i * i;
    }));
  }
  for (int i = 0; i < 200; ++i) EXPECT_EQ(futures[i].get(), i * i);
  for (int place = 0; place < 200; ++place) {
    EXPECT_LE(begun[place] - place, std::max(0, pool.workers() - 1)) << place;
  }
}

TEST_P(ThreadPoolTest, WhatABodyThrowsReachesTheCallerOnceNobodyRunsIt) {
  ThreadPool pool(GetParam());
  std::atomic<int> running = 0;
  const auto body = [&](int i) {
    ++running;
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    --running;
    if (i % 7 == 3) throw std::bad_alloc();
  };
  EXPECT_THROW(pool.parallel_for(50, body), std::bad_alloc);
  EXPECT_EQ(running, 0);
  std::atomic<int> sum = 0;
  pool.parallel_for(100, [&](int i) { sum += i; });
  EXPECT_EQ(sum, 4950);
}

TEST_P(ThreadPoolTest, WhatSubmittedWorkThrowsComesWithItsValue) {
  ThreadPool pool(GetParam());
  std::future<int> value = pool.submit([]() -> int { throw std::bad_alloc(); });
  EXPECT_THROW(value.get(), std::bad_alloc);
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

// A limit of memory stops the making of threads as one of processes does, and also for root.
TEST(ThreadPool, WorksWithTheThreadsThatItGets) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer needs the memory";
#endif
  constexpr int kWanted = 64;
  for (const rlim_t stacks : {0, 2, 5}) {
    size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    rlimit before{}, stack{};
    getrlimit(RLIMIT_AS, &before);
    getrlimit(RLIMIT_STACK, &stack);
    if (stack.rlim_cur == RLIM_INFINITY) GTEST_SKIP() << "stacks have no limit";
    rlimit tight = before;
    tight.rlim_cur = pages * sysconf(_SC_PAGESIZE) + (stacks + 1) * stack.rlim_cur;
    setrlimit(RLIMIT_AS, &tight);
    {
      ThreadPool pool(kWanted);
      EXPECT_LT(pool.workers(), kWanted);
      setrlimit(RLIMIT_AS, &before);
      std::atomic<int> sum = 0;
      pool.parallel_for(100, [&](int i) { sum += i; });
      EXPECT_EQ(sum, 4950);
      EXPECT_EQ(pool.submit([] { return 7; }).get(), 7);
    }
    setrlimit(RLIMIT_AS, &before);
  }
}

}  // namespace
}  // namespace raysfm
