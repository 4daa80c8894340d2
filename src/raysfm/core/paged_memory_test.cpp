#include "raysfm/core/paged_memory.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/core/slab_allocator.h"
#include "support/own_process.h"

namespace raysfm {
namespace {

constexpr size_t kMib = size_t{1} << 20, kResident = 32 * kMib;

// Bytes of files that are in memory for this process; what a sanitizer keeps of each address is not among
// them.
size_t resident() {
  size_t all = 0, any = 0, of_files = 0;
  std::ifstream("/proc/self/statm") >> all >> any >> of_files;
  return of_files * 4096;
}

void start_paging() {
  ASSERT_TRUE(page_to(testing::TempDir(), kResident));
}

// Each number says where it is and whose.
uint64_t number_at(size_t array, size_t i) {
  return array << 48 | i * 2654435761u % 0xffffffffffff;
}

LargeArray<uint64_t> numbers(size_t array, size_t count) {
  LargeArray<uint64_t> all(count);
  for (size_t i = 0; i < count; ++i) all[i] = number_at(array, i);
  return all;
}

void expect_numbers(const LargeArray<uint64_t>& all, size_t array) {
  for (size_t i = 0; i < all.size(); ++i) ASSERT_EQ(all[i], number_at(array, i));
}

TEST(PagedMemory, KeepsWhatIsFarOutOfMemoryAndBringsItBackUnchanged) {
  run_alone([] {
    start_paging();
    constexpr size_t kArrays = 20, kEach = 20 * kMib / sizeof(uint64_t);
    const size_t before = resident(), paged_before = paged_bytes();
    std::vector<LargeArray<uint64_t>> arrays;
    for (size_t a = 0; a < kArrays; ++a) arrays.push_back(numbers(a, kEach));
    EXPECT_EQ(paged_bytes() - paged_before, 20 * kArrays * kMib);
    // The thread that lets go of it may have to wait for a processor.
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (resident() > before + 2 * kResident && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_LT(resident(), before + 2 * kResident);
    for (size_t a = 0; a < kArrays; ++a) expect_numbers(arrays[a], a);
    arrays.clear();
    EXPECT_EQ(paged_bytes(), paged_before);
  });
}

TEST(PagedMemory, SlabsLieInItToo) {
  run_alone([] {
    start_paging();
    const size_t before = paged_bytes();
    std::vector<std::vector<int, SlabAllocator<int>>> blocks(10000,
                                                             std::vector<int, SlabAllocator<int>>(500));
    EXPECT_GT(paged_bytes() - before, 10000u * 2000);
    blocks.clear();
    EXPECT_LT(paged_bytes() - before, kMib);  // one slab may stay for the next block
  });
}

// Arrays of all sizes that come and go in any order.
TEST(PagedMemory, ArraysDoNotTouchEachOtherAndTheirRoomIsUsedAgain) {
  run_alone([] {
    start_paging();
    Rng rng(1);
    std::vector<std::pair<size_t, LargeArray<uint64_t>>> arrays;
    const size_t before = paged_bytes();
    for (size_t i = 0; i < 2000; ++i) {
      if (arrays.size() < 30 || rng.uniform() < 0.5) {
        const size_t count = 1 + rng.index(100000);
        arrays.emplace_back(i, numbers(i, count));
        EXPECT_EQ(reinterpret_cast<uintptr_t>(arrays.back().second.data()) % 64, 0u);
        if (arrays.size() < 60) continue;
      }
      std::swap(arrays[rng.index(static_cast<uint32_t>(arrays.size()))], arrays.back());
      expect_numbers(arrays.back().second, arrays.back().first);
      arrays.pop_back();
    }
    for (const auto& [number, array] : arrays) expect_numbers(array, number);
    arrays.clear();
    EXPECT_EQ(paged_bytes(), before);
  });
}

TEST(PagedMemory, LeavesNoFileThatHasAName) {
  run_alone([] {
    start_paging();
    const LargeArray<uint64_t> some = numbers(1, kMib);
    EXPECT_GE(paged_bytes(), 8 * kMib);
    for (const auto& entry : std::filesystem::directory_iterator(testing::TempDir())) {
      EXPECT_EQ(entry.path().filename().string().find("raysfm-pages"), std::string::npos);
    }
  });
}

TEST(PagedMemory, TakesMemoryAsBeforeWhereTheDiskIsFull) {
  run_alone([] {
    constexpr rlim_t kMost = 16 * kMib;  // of a file
    const rlimit limit{kMost, kMost};
    std::signal(SIGXFSZ, SIG_IGN);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
    start_paging();
    const LargeArray<uint64_t> first = numbers(1, kMib), second = numbers(2, kMib), third = numbers(3, kMib);
    expect_numbers(first, 1);
    expect_numbers(second, 2);
    expect_numbers(third, 3);
    EXPECT_GT(paged_bytes(), 0u);
    EXPECT_LE(paged_bytes(), kMost);
  });
}

TEST(PagedMemory, IsRefusedWithoutAFolder) {
  run_alone([] {
    const Result<void> refused = page_to("/no/such/folder", kResident);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message.find("/no/such/folder"), std::string::npos);
    expect_numbers(numbers(1, kMib), 1);
    EXPECT_EQ(paged_bytes(), 0u);
  });
}

TEST(PagedMemory, BeginsWhereMoreIsNeededThanMayBeInMemory) {
  run_alone([] {
    page_beyond(16 * kMib, testing::TempDir(), kResident);
    const LargeArray<uint64_t> first = numbers(1, kMib);
    for (int i = 0; i < 4; ++i) expect_numbers(numbers(2, kMib / 2), 2);  // what is freed does not count
    EXPECT_EQ(paged_bytes(), 0u);
    const LargeArray<uint64_t> second = numbers(2, kMib / 2), third = numbers(3, kMib);
    EXPECT_EQ(paged_bytes(), 8 * kMib);
    expect_numbers(first, 1);
    expect_numbers(second, 2);
    expect_numbers(third, 3);
  });
}

TEST(PagedMemory, StaysInMemoryWhereThereCanBeNoFile) {
  run_alone([] {
    page_beyond(kMib, "/no/such/folder", kResident);
    for (uint64_t i = 0; i < 3; ++i) expect_numbers(numbers(i, kMib), i);
    EXPECT_EQ(paged_bytes(), 0u);
  });
}

// Of this process, that the system brought in without reading a file.
long pages_touched() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_minflt;
}

TEST(LargeArray, TouchesFewPages) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer keeps pages of its own";
#endif
  if (!has_large_pages()) GTEST_SKIP() << "this system has no large pages";
  constexpr long kMost = 4096;  // of 16384 small ones: not every large page is to be had
  const long before = pages_touched();
  const LargeArray<uint64_t> all = numbers(0, 64 * kMib / sizeof(uint64_t));
  EXPECT_LT(pages_touched() - before, kMost);
  expect_numbers(all, 0);
}

TEST(LargeArray, HoldsWhatIsWrittenAtAnySize) {
  for (const size_t size : {size_t{1}, kMib / 8 - 1, kMib / 8, kMib / 4 + 1, kMib}) {
    LargeArray<uint64_t> all = numbers(1, size);
    all.push_back(number_at(1, size));
    expect_numbers(all, 1);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(all.data()) % 64, 0u);
  }
}

TEST(ScratchArray, IsNotFilledAndKeepsItsMemory) {
  ScratchArray<int> scratch;
  set_size(scratch, 1000);
  std::fill(scratch.begin(), scratch.end(), 7);
  const int* const place = scratch.data();
  set_size(scratch, 10);
  set_size(scratch, 1000);
  EXPECT_EQ(scratch.size(), 1000u);
  EXPECT_EQ(scratch.data(), place);
  EXPECT_EQ(std::count(scratch.begin(), scratch.end(), 7), 1000);
}

TEST(ScratchArray, IsFilledWhereThatIsAskedFor) {
  const ScratchArray<int> filled(5, 3);
  EXPECT_EQ(std::count(filled.begin(), filled.end(), 3), 5);
}

}  // namespace
}  // namespace raysfm
