#include "raysfm/core/slab_allocator.h"

#include <sys/mman.h>

#include <array>
#include <bit>
#include <cstdint>
#include <mutex>

#include "raysfm/core/paged_memory.h"

namespace raysfm {
namespace {

constexpr size_t kSlabBytes = 128 << 10;  // slabs lie at multiples of it
constexpr size_t kBroughtIn = 16 << 10;   // of a slab at once: no block is larger
constexpr size_t kFineStep = 16, kFineEnd = 256;
static_assert(kBroughtIn >= kLargestSlabBlock && kSlabBytes % kBroughtIn == 0);
constexpr int kFineClasses = kFineEnd / kFineStep, kClasses = kFineClasses + 8 * 6;

// Sizes in steps of 16 bytes, and of an eighth of a power of two beyond 256.
struct SizeClass {
  int number;
  size_t bytes;  // of its blocks
};

SizeClass class_of(size_t bytes) {
  const size_t last = bytes == 0 ? 0 : bytes - 1;
  if (last < kFineEnd) return {static_cast<int>(last / kFineStep), (last / kFineStep + 1) * kFineStep};
  const int shift = std::bit_width(last) - 4;
  const size_t eighth = last >> shift;  // 8 to 15
  const int doubling = std::bit_width(last) - std::bit_width(kFineEnd);
  return {kFineClasses + 8 * doubling + static_cast<int>(eighth) - 8, (eighth + 1) << shift};
}

struct FreeBlock {
  FreeBlock* next;
};

// Pages that will be written soon, in half the time that each takes by itself. Where the system does not know
// how, they come when they are written.
void bring_in([[maybe_unused]] char* pages, [[maybe_unused]] size_t bytes) {
#ifdef MADV_POPULATE_WRITE
  ::madvise(pages, bytes, MADV_POPULATE_WRITE);
#endif
}

// Stands at the beginning of its memory; the blocks follow.
struct alignas(16) Slab {
  Slab *previous = nullptr, *next = nullptr;  // of those with room
  FreeBlock* freed = nullptr;
  size_t untouched = sizeof(Slab);  // offset of what was never used
  size_t blocks = 0;                // in use
  size_t brought_in = kSlabBytes;   // offset of what was not, a multiple of kBroughtIn

  bool has_room(size_t bytes) const { return freed || untouched + bytes <= kSlabBytes; }

  void* take(size_t bytes) {
    ++blocks;
    void* block = freed;
    if (freed) {
      freed = freed->next;
    } else {
      block = reinterpret_cast<char*>(this) + untouched;
      untouched += bytes;
      if (untouched > brought_in) {
        bring_in(reinterpret_cast<char*>(this) + brought_in, kBroughtIn);
        brought_in += kBroughtIn;
      }
    }
    return block;
  }
  void put_back(void* block) {
    --blocks;
    freed = ::new (block) FreeBlock{freed};
  }
};

Slab* slab_of(void* block) {
  return reinterpret_cast<Slab*>(reinterpret_cast<uintptr_t>(block) & ~(kSlabBytes - 1));
}

// From the system, twice as much first, of which what is not aligned goes back.
Slab* new_slab() {
  if (void* const paged = allocate_paged(kSlabBytes, kSlabBytes)) return ::new (paged) Slab;
  void* const mapped =
      ::mmap(nullptr, 2 * kSlabBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) throw std::bad_alloc();
  char* const begin = static_cast<char*>(mapped);
  char* const aligned = reinterpret_cast<char*>(slab_of(begin + kSlabBytes - 1));
  if (aligned > begin) ::munmap(begin, aligned - begin);
  ::munmap(aligned + kSlabBytes, begin + kSlabBytes - aligned);
  bring_in(aligned, kBroughtIn);
  Slab* const slab = ::new (aligned) Slab;
  slab->brought_in = kBroughtIn;
  return slab;
}

class Slabs {
 public:
  void* allocate(size_t bytes) {
    const SizeClass size = class_of(bytes);
    const std::lock_guard lock(mutex_);
    Slab*& first = with_room_[size.number];
    if (!first) first = new_slab();
    Slab* const slab = first;
    void* const block = slab->take(size.bytes);
    if (!slab->has_room(size.bytes)) unlink(slab, &first);
    in_use_ += size.bytes;
    return block;
  }

  // One slab of each size stays, for the next block.
  void free(void* block, size_t bytes) {
    const SizeClass size = class_of(bytes);
    const std::lock_guard lock(mutex_);
    Slab*& first = with_room_[size.number];
    Slab* const slab = slab_of(block);
    if (!slab->has_room(size.bytes)) link(slab, &first);
    slab->put_back(block);
    in_use_ -= size.bytes;
    if (slab->blocks > 0 || (slab == first && !slab->next)) return;
    unlink(slab, &first);
    if (!free_paged(slab, kSlabBytes)) ::munmap(slab, kSlabBytes);
  }

  size_t in_use() {
    const std::lock_guard lock(mutex_);
    return in_use_;
  }

 private:
  static void link(Slab* slab, Slab** first) {
    slab->next = *first;
    if (*first) (*first)->previous = slab;
    *first = slab;
  }
  static void unlink(Slab* slab, Slab** first) {
    (slab->previous ? slab->previous->next : *first) = slab->next;
    if (slab->next) slab->next->previous = slab->previous;
    slab->previous = slab->next = nullptr;
  }

  std::mutex mutex_;
  std::array<Slab*, kClasses> with_room_{};  // lists by size
  size_t in_use_ = 0;
};

// Outlives every static object that may hold memory of it.
Slabs& slabs() {
  static Slabs* const slabs = new Slabs;
  return *slabs;
}

}  // namespace

void* allocate_in_slab(size_t bytes) {
  return slabs().allocate(bytes);
}
void free_in_slab(void* block, size_t bytes) noexcept {
  slabs().free(block, bytes);
}
size_t slab_bytes_in_use() {
  return slabs().in_use();
}

}  // namespace raysfm
