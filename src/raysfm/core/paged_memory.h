#pragma once

#include <cstddef>
#include <filesystem>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Memory that lies in a file, so that a long run needs no more of the machine's than what it works on: what
// is far is in the file. Off until page_to() is called, and never of any effect on a result.

// From now on slabs (slab_allocator.h) and large arrays, all that grows with a map, lie in a file without a
// name in `folder`, of which no more than about `resident` bytes stay mapped: a thread lets go of the rest,
// which the system writes when it needs the room, and reads when it is asked for. The file is gone with the
// process, however that ends. Where the disk is full, memory is taken as before. Later calls change nothing.
// Error: internal, where the file system or the system has no such files; nothing is changed then.
Result<void> page_to(const std::filesystem::path& folder, size_t resident);

// The same for what would take more than `in_memory` bytes at once, and for all after it: until then there is
// neither file nor thread, and where there can be no file, memory is taken as before. Later calls change the
// number and where the file will be.
void page_beyond(size_t in_memory, const std::filesystem::path& folder, size_t resident);

// Bytes of the file that are in use; 0 where there is none.
size_t paged_bytes();

// `bytes` of the file at a multiple of `alignment`, a power of two. Null where there is no file or no room;
// the caller then takes as many from elsewhere, which is counted.
void* allocate_paged(size_t bytes, size_t alignment);
// Gives them back, with the number of bytes that was asked for; false, where they are not of the file, and
// only the count falls.
bool free_paged(void* block, size_t bytes) noexcept;

// Aligned to a line of the cache; in the file where there is one and the block is large. What of other blocks
// fills pages of the large size of the system lies in such pages, where there are any. Throws
// std::bad_alloc.
void* allocate_large(size_t bytes);
void free_large(void* block, size_t bytes) noexcept;

// For containers.
template <typename T>
struct LargeAllocator {
  static_assert(alignof(T) <= 64);
  using value_type = T;

  LargeAllocator() = default;
  template <typename U>
  LargeAllocator(const LargeAllocator<U>&) {}

  T* allocate(size_t count) { return static_cast<T*>(allocate_large(count * kSize)); }
  void deallocate(T* block, size_t count) noexcept { free_large(block, count * kSize); }
  bool operator==(const LargeAllocator&) const { return true; }

 private:
  static constexpr size_t kSize = sizeof(T);  // NOLINT(bugprone-sizeof-expression): may be a pointer
};

// An array that may grow with a whole map. SIMD kernels load it by whole lines of the cache: the first
// element is aligned to 64 bytes.
template <typename T>
using LargeArray = std::vector<T, LargeAllocator<T>>;

// The same without a first value, for what is written before it is read.
template <typename T>
struct ScratchAllocator : LargeAllocator<T> {
  using value_type = T;

  ScratchAllocator() = default;
  template <typename U>
  ScratchAllocator(const ScratchAllocator<U>&) {}

  template <typename U>
  void construct(U* place) noexcept {
    static_assert(std::is_trivially_destructible_v<U>);
    ::new (static_cast<void*>(place)) U;
  }
  template <typename U, typename... Arguments>
  void construct(U* place, Arguments&&... arguments) {
    ::new (static_cast<void*>(place)) U(std::forward<Arguments>(arguments)...);
  }
};

// An array whose new elements hold anything: see set_size().
template <typename T>
using ScratchArray = std::vector<T, ScratchAllocator<T>>;

// What the array held is lost; memory only grows, and nothing is copied or filled.
template <typename T>
void set_size(ScratchArray<T>& array, size_t size) {
  array.clear();
  array.resize(size);
}

}  // namespace raysfm
