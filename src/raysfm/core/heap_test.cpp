#include "raysfm/core/heap.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "support/own_process.h"

namespace raysfm {
namespace {

constexpr size_t kMebibyte = size_t{1} << 20;

// Bytes of addresses of the heap that ask for large pages.
size_t in_large_pages() {
  std::ifstream smaps("/proc/self/smaps");
  std::string line;
  uintptr_t begin = 0, end = 0;
  size_t bytes = 0;
  bool of_heap = false;
  while (std::getline(smaps, line)) {
    std::istringstream words(line);
    char dash = 0;
    if (line.find('-') < line.find(' ') && (words >> std::hex >> begin >> dash >> end)) {
      of_heap = line.ends_with("[heap]");
    } else if (of_heap && line.starts_with("VmFlags:") && line.find(" hg") != std::string::npos) {
      bytes += end - begin;
    }
  }
  return bytes;
}

// Another allocator than that of the C library, as that of a sanitizer, has no heap.
bool has_heap() {
  const void* const before = ::sbrk(0);
  std::vector<std::unique_ptr<char[]>> blocks;
  for (int i = 0; i < 64; ++i) blocks.push_back(std::make_unique<char[]>(100'000));
  return ::sbrk(0) != before;
}

TEST(Heap, GrowsInLargePages) {
  if (!has_large_pages() || !has_heap()) GTEST_SKIP() << "no large pages, or no heap";
  run_alone([] {
    EXPECT_EQ(in_large_pages(), 0u);
    prepare_heap();
    EXPECT_GT(in_large_pages(), 500 * kMebibyte);
    std::vector<std::vector<char>> images;
    for (int i = 0; i < 100; ++i) images.emplace_back(450'000, 'x');
    images.clear();
    return_freed_memory();
    EXPECT_GT(in_large_pages(), 400 * kMebibyte);
  });
}

// Images of different frames, freed and taken again, and a limit that leaves no room for what is reserved.
TEST(Heap, WorksWhereNothingCanBeReserved) {
  if (!has_heap()) GTEST_SKIP() << "no heap";
  run_alone([] {
    rlimit limit{};
    getrlimit(RLIMIT_DATA, &limit);
    limit.rlim_cur = 200 * kMebibyte;
    ASSERT_EQ(setrlimit(RLIMIT_DATA, &limit), 0);
    prepare_heap();
    EXPECT_EQ(in_large_pages(), 0u);
    for (int round = 0; round < 3; ++round) {
      std::vector<std::vector<char>> images;
      for (int i = 0; i < 200; ++i) images.emplace_back(450'000 + round, 'x');
      images.clear();
      return_freed_memory();
    }
  });
}

TEST(Heap, ThreadsShareIt) {
  if (!has_heap()) GTEST_SKIP() << "no heap";
  run_alone([] {
    prepare_heap();
    const auto* const end = static_cast<const char*>(::sbrk(0));
    std::vector<std::unique_ptr<char[]>> blocks(4);
    std::vector<std::thread> threads;
    for (auto& block : blocks) threads.emplace_back([&block] { block = std::make_unique<char[]>(1000); });
    for (std::thread& thread : threads) thread.join();
    const auto in_heap = [&](const auto& block) {
      return block.get() < end && block.get() > end - 600 * kMebibyte;
    };
    EXPECT_TRUE(std::ranges::all_of(blocks, in_heap));
  });
}

}  // namespace
}  // namespace raysfm
