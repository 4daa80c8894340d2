#include "raysfm/core/heap.h"

#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>

namespace raysfm {
namespace {

// Large images come and go with every frame while small things stay: in one heap they would leave holes of
// their size, 400 MiB of them over 40 panoramas of 29 megapixels.
constexpr int kMapped = 4 << 20;
constexpr int kMostOfHeap = 512 << 20;  // bytes of addresses, of which only what is used is memory
constexpr int kStep = 128 << 10;        // by which the heap grows beyond them, as ever

uintptr_t prepared_from = 0;  // 0: nothing is

uintptr_t end_of_heap() {
  return reinterpret_cast<uintptr_t>(::sbrk(0));
}

uintptr_t next_page() {
  const auto page = static_cast<uintptr_t>(::getpagesize());
  return (end_of_heap() + page - 1) / page * page;
}

// The C library asks for large pages where an environment variable says so that it reads before main(). Here
// the heap is made to grow once, by all of it, and the pages are asked for by hand. Where so much is refused,
// the block is null and nothing has changed.
void reserve() {
  const uintptr_t begin = next_page();
  mallopt(M_TOP_PAD, kMostOfHeap);
  void* volatile block = std::malloc(kMapped / 2);  // volatile, or the compiler sees that nobody needs it
  std::free(block);
  mallopt(M_TOP_PAD, kStep);
  const uintptr_t end = end_of_heap();
  if (end > begin + kMostOfHeap) ::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

}  // namespace

void prepare_heap() {
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, kMapped);
  // What one frame frees the next one takes: given back to the system in between, its pages would have to be
  // brought in anew.
  mallopt(M_TRIM_THRESHOLD, kMostOfHeap + kMapped);
  prepared_from = next_page();
  reserve();
}

void return_freed_memory() {
  malloc_trim(0);
  if (prepared_from == 0) return;
  // The system makes large pages of small ones again as it finds the time, the holes between them included:
  // 8 MiB of a drive of 1000 frames, in one run of four.
  const uintptr_t end = end_of_heap();
  if (end > prepared_from)
    ::madvise(reinterpret_cast<void*>(prepared_from), end - prepared_from, MADV_NOHUGEPAGE);
  reserve();
}

}  // namespace raysfm
