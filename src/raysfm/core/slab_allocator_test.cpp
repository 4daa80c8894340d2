#include "raysfm/core/slab_allocator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <thread>
#include <utility>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

struct TestBlock {
  unsigned char* begin;
  size_t bytes;
  unsigned char mark;
};

TestBlock new_block(size_t bytes, unsigned char mark) {
  const TestBlock block{static_cast<unsigned char*>(allocate_in_slab(bytes)), bytes, mark};
  std::memset(block.begin, mark, bytes);
  return block;
}

void expect_untouched(const TestBlock& block) {
  for (size_t i = 0; i < block.bytes; ++i) ASSERT_EQ(block.begin[i], block.mark) << block.bytes;
}

// Blocks of all sizes that come and go in any order, each with bytes of its own.
void come_and_go(uint64_t seed) {
  Rng rng(seed);
  std::vector<TestBlock> blocks;
  for (int i = 0; i < 20000; ++i) {
    if (blocks.size() < 500 || rng.uniform() < 0.5) {
      const double bytes = std::exp2(rng.uniform(0, 14));
      blocks.push_back(new_block(static_cast<size_t>(bytes), static_cast<unsigned char>(i)));
      EXPECT_EQ(reinterpret_cast<uintptr_t>(blocks.back().begin) % 16, 0u);
      continue;
    }
    std::swap(blocks[rng.index(static_cast<uint32_t>(blocks.size()))], blocks.back());
    expect_untouched(blocks.back());
    free_in_slab(blocks.back().begin, blocks.back().bytes);
    blocks.pop_back();
  }
  for (const TestBlock& block : blocks) {
    expect_untouched(block);
    free_in_slab(block.begin, block.bytes);
  }
}

TEST(SlabAllocator, BlocksDoNotTouchEachOther) {
  const size_t before = slab_bytes_in_use();
  std::thread other([] { come_and_go(1); });
  come_and_go(2);
  other.join();
  EXPECT_EQ(slab_bytes_in_use(), before);
}

TEST(SlabAllocator, WastesNoMoreThanAnEighth) {
  for (size_t bytes = 1; bytes <= kLargestSlabBlock; ++bytes) {
    const size_t before = slab_bytes_in_use();
    void* const block = allocate_in_slab(bytes);
    const size_t taken = slab_bytes_in_use() - before;
    ASSERT_GE(taken, bytes);
    ASSERT_LE(taken, std::max(bytes + 15, bytes * 9 / 8)) << bytes;
    free_in_slab(block, bytes);
  }
}

size_t resident_pages() {
  size_t all = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> all >> resident;
  return resident;
}

TEST(SlabAllocator, GivesMemoryBackToTheSystem) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the thread sanitizer keeps pages of its own";
#endif
  constexpr size_t kBytes = 1000, kBlocks = 64000, kPage = 4096;
#if defined(__SANITIZE_ADDRESS__)
  constexpr size_t kShadow = kBlocks * kBytes / kPage / 8;  // what the address sanitizer keeps of addresses
#else
  constexpr size_t kShadow = 0;
#endif
  std::vector<TestBlock> blocks(kBlocks);  // touched, and none of it freed: sanitizers keep what is
  blocks.clear();
  const size_t before = resident_pages();
  for (size_t i = 0; i < kBlocks; ++i) blocks.push_back(new_block(kBytes, 1));
  EXPECT_GT(resident_pages(), before + kBlocks * kBytes / kPage);
  for (const TestBlock& block : blocks) free_in_slab(block.begin, block.bytes);
  EXPECT_LT(resident_pages(), before + kShadow + kBlocks * kBytes / kPage / 10);
}

TEST(SlabAllocator, ServesContainersOfAnyLength) {
  const size_t before = slab_bytes_in_use();
  {
    std::vector<int, SlabAllocator<int>> numbers;
    for (int i = 0; i < 100000; ++i) numbers.push_back(i);
    for (int i = 0; i < 100000; ++i) ASSERT_EQ(numbers[i], i);
    numbers.resize(100);
    numbers.shrink_to_fit();
    EXPECT_EQ(slab_bytes_in_use() - before, 400u + 16u);
  }
  EXPECT_EQ(slab_bytes_in_use(), before);
}

}  // namespace
}  // namespace raysfm
