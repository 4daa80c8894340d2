#pragma once

#include <cstddef>
#include <new>

#include "raysfm/core/paged_memory.h"

namespace raysfm {

// Memory for the many small arrays that a map keeps for as long as the video lasts. In the heap they would
// sit in the holes that images leave, so that the next image finds none and the heap grows by what is free in
// it. Blocks of like size share slabs instead; a slab goes back to the system with its last block. Any
// thread.
constexpr size_t kLargestSlabBlock = 16 << 10;  // bytes

// At most kLargestSlabBlock bytes, aligned to 16. Throws std::bad_alloc.
void* allocate_in_slab(size_t bytes);
// With the number of bytes that was asked for.
void free_in_slab(void* block, size_t bytes) noexcept;

// Bytes of all blocks in use, in the whole process.
size_t slab_bytes_in_use();

// For containers; larger arrays lie as those of LargeAllocator do.
template <typename T>
struct SlabAllocator {
  static_assert(alignof(T) <= 16);
  using value_type = T;

  SlabAllocator() = default;
  template <typename U>
  SlabAllocator(const SlabAllocator<U>&) {}

  T* allocate(size_t count) {
    const size_t bytes = count * kSize;
    return static_cast<T*>(bytes > kLargestSlabBlock ? allocate_large(bytes) : allocate_in_slab(bytes));
  }
  void deallocate(T* block, size_t count) noexcept {
    const size_t bytes = count * kSize;
    bytes > kLargestSlabBlock ? free_large(block, bytes) : free_in_slab(block, bytes);
  }
  bool operator==(const SlabAllocator&) const { return true; }

 private:
  static constexpr size_t kSize =
      sizeof(T);  // NOLINT(bugprone-sizeof-expression): nodes of a deque are pointers
};

}  // namespace raysfm
