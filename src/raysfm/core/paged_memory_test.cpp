#include "raysfm/core/paged_memory.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

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

// Memory is paged for the rest of a process: each of these has one of its own, which says what failed.
void run_alone(void (*test)()) {
  EXPECT_EXIT(
      {
        test();
        std::exit(testing::Test::HasFailure() ? 1 : 0);
      },
      testing::ExitedWithCode(0), "");
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

}  // namespace
}  // namespace raysfm
