#include "raysfm/core/paged_memory.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <new>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

namespace raysfm {
namespace {

constexpr size_t kPage = 4096;
constexpr size_t kReserved = size_t{256} << 30;  // bytes of addresses, the most that the file can have
constexpr size_t kMostAligned = 1 << 20;
constexpr size_t kLeastPaged = 64 << 10;  // smaller arrays are left to the heap, and not counted
constexpr size_t kLargePage = 2 << 20;
constexpr size_t kMostWasted = 128 << 10;  // bytes of the last large page of a block
// Smaller blocks lie in the heap (heap.h), where to align them would bring in a large page on either side.
constexpr size_t kLeastInLargePages = 2 * kLargePage - kMostWasted;
constexpr std::align_val_t kCacheLine{64}, kLargePageLine{kLargePage};
constexpr std::chrono::milliseconds kWatched{2};

size_t rounded_up(size_t value, size_t step) {
  return (value + step - 1) / step * step;
}

// Bytes of files that are mapped and in memory, those of the program itself among them.
class ResidentOfFiles {
 public:
  ResidentOfFiles() : statm_(::open("/proc/self/statm", O_RDONLY | O_CLOEXEC)) {}

  size_t now() const {
    char text[128] = {};
    size_t of_files = 0;
    if (::pread(statm_, text, sizeof text - 1, 0) > 0) std::sscanf(text, "%*s %*s %zu", &of_files);
    return of_files * kPage;
  }

 private:
  int statm_;
};

// The calling thread works for a moment at a time and should not wait for those that compute: from Linux 6.12
// on it may say so, before that nothing happens.
void ask_for_short_turns() {
  struct {
    uint32_t size = 48, policy = 0;
    uint64_t flags = 0;
    int32_t nice = 0;
    uint32_t priority = 0;
    uint64_t runtime = 100'000, deadline = 0, period = 0;  // nanoseconds
  } attributes;
  ::syscall(SYS_sched_setattr, 0, &attributes, 0);
}

// A file that has no name, or none any more; -1 where there is none to be had.
int open_nameless(const std::filesystem::path& folder) {
  const int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file >= 0) return file;
  std::string name = (folder / "raysfm-pages-XXXXXX").string();
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return named;
}

// All of the file is mapped at once; only what is allocated exists.
class PageFile {
 public:
  PageFile(int file, char* mapped, size_t resident)
      : file_(file),
        base_(reinterpret_cast<char*>(rounded_up(reinterpret_cast<uintptr_t>(mapped), kMostAligned))),
        skipped_(base_ - mapped),
        resident_(resident) {}

  size_t used() const { return used_; }
  bool owns(const void* block) const { return block >= base_ && block < base_ + (kReserved - kMostAligned); }

  void* allocate(size_t bytes, size_t alignment) {
    const size_t length = rounded_up(bytes, kPage);
    const std::lock_guard lock(mutex_);
    const size_t begin = take(length, std::max(alignment, kPage));
    if (begin == kNone) return nullptr;
    if (length > resident_ / 4) let_go();  // it is about to be filled
    if (::fallocate(file_, 0, static_cast<off_t>(skipped_ + begin), static_cast<off_t>(length)) != 0) {
      put_back(begin, length);
      return nullptr;
    }
    used_ += length;
    return base_ + begin;
  }

  void free(void* block, size_t bytes) noexcept {
    const size_t length = rounded_up(bytes, kPage);
    ::madvise(block, length, MADV_REMOVE);
    const std::lock_guard lock(mutex_);
    used_ -= length;
    try {
      put_back(static_cast<char*>(block) - base_, length);
    } catch (const std::bad_alloc&) {  // these addresses are not used again
    }
  }

  // Lets go of everything whenever too much of it is in memory: what is in use comes back at once, from the
  // system's cache of the file as long as there is room for that.
  void watch() const {
    ask_for_short_turns();
    const ResidentOfFiles resident;
    size_t others = resident.now(), left = others;
    for (;;) {
      std::this_thread::sleep_for(kWatched);
      if (used_ <= resident_ || resident.now() <= others + resident_) continue;
      let_go();
      // Others may have gone on meanwhile, which it must not take for what is not of the file.
      const size_t now = resident.now();
      others = std::min(now, std::exchange(left, now));
    }
  }

 private:
  static constexpr size_t kNone = SIZE_MAX;

  void let_go() const { ::madvise(base_, end_, MADV_DONTNEED); }

  // The first place that is large enough.
  size_t take(size_t length, size_t alignment) {
    for (auto [begin, free] : free_) {
      const size_t aligned = rounded_up(begin, alignment);
      if (aligned + length > begin + free) continue;
      free_.erase(begin);
      if (aligned > begin) free_.emplace(begin, aligned - begin);
      if (aligned + length < begin + free) free_.emplace(aligned + length, begin + free - aligned - length);
      return aligned;
    }
    const size_t end = end_, aligned = rounded_up(end, alignment);
    if (length > kReserved - kMostAligned || aligned > kReserved - kMostAligned - length) return kNone;
    if (aligned > end) free_.emplace(end, aligned - end);
    end_ = aligned + length;
    return aligned;
  }

  void put_back(size_t begin, size_t length) {
    const auto after = free_.lower_bound(begin);
    if (after != free_.end() && after->first == begin + length) {
      length += after->second;
      free_.erase(after);
    }
    const auto next = free_.lower_bound(begin);
    if (next != free_.begin()) {
      const auto before = std::prev(next);
      if (before->first + before->second == begin) {
        before->second += length;
        return;
      }
    }
    free_.emplace(begin, length);
  }

  int file_;
  char* base_;
  size_t skipped_;  // bytes of the file before base_
  size_t resident_;
  std::mutex mutex_;
  std::map<size_t, size_t> free_;  // lengths by where they begin, with something in use between
  std::atomic<size_t> end_ = 0, used_ = 0;
};

// Never ends: memory of it outlives every static object.
std::atomic<PageFile*> page_file = nullptr;

// What page_beyond() was told.
struct Overflow {
  std::mutex mutex;
  std::filesystem::path folder;
  size_t resident = 0;
};
Overflow& overflow() {
  static Overflow* const told = new Overflow;
  return *told;
}
std::atomic<size_t> most_in_memory = SIZE_MAX, bytes_in_memory = 0;

// Tries once: where it fails, nothing is too much any more.
void begin_to_page() {
  const std::lock_guard lock(overflow().mutex);
  if (most_in_memory.exchange(SIZE_MAX) == SIZE_MAX) return;
  static_cast<void>(page_to(overflow().folder, overflow().resident));
}

}  // namespace

Result<void> page_to(const std::filesystem::path& folder, size_t resident) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  if (page_file != nullptr) return {};
  const auto failed = [&](const char* what) {
    return internal_error(fmt::format("{}: {}: {}", folder.string(), what, std::strerror(errno)));
  };
  const int file = open_nameless(folder.empty() ? "." : folder);
  if (file < 0) return failed("no file for what does not fit into memory");
  if (::fallocate(file, 0, 0, kPage) != 0) {
    const Result<void> failure = failed("no room can be kept in a file");
    ::close(file);
    return failure;
  }
  void* const mapped =
      ::mmap(nullptr, kReserved, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, file, 0);
  if (mapped == MAP_FAILED) {
    const Result<void> failure = failed("no addresses for a file");
    ::close(file);
    return failure;
  }
  ::madvise(mapped, kReserved, MADV_DONTDUMP);
  auto* const pages = new PageFile(file, static_cast<char*>(mapped), resident);
  try {
    std::thread([pages] { pages->watch(); }).detach();
  } catch (const std::system_error& failure) {
    return internal_error(fmt::format("no thread that watches the memory: {}", failure.what()));
  }
  page_file = pages;
  return {};
}

void page_beyond(size_t in_memory, const std::filesystem::path& folder, size_t resident) {
  const std::lock_guard lock(overflow().mutex);
  overflow().folder = folder;
  overflow().resident = resident;
  most_in_memory = in_memory;
}

size_t paged_bytes() {
  const PageFile* const pages = page_file;
  return pages ? pages->used() : 0;
}

void* allocate_paged(size_t bytes, size_t alignment) {
  if (bytes_in_memory + bytes > most_in_memory) begin_to_page();
  PageFile* const pages = page_file;
  void* const block = pages ? pages->allocate(bytes, alignment) : nullptr;
  if (!block) bytes_in_memory += bytes;
  return block;
}

bool free_paged(void* block, size_t bytes) noexcept {
  PageFile* const pages = page_file;
  if (!pages || !pages->owns(block)) {
    bytes_in_memory -= bytes;
    return false;
  }
  pages->free(block, bytes);
  return true;
}

void* allocate_large(size_t bytes) {
  if (bytes < kLeastPaged) return ::operator new(bytes, kCacheLine);
  if (void* const block = allocate_paged(bytes, kPage)) return block;
  if (bytes < kLeastInLargePages || bytes > SIZE_MAX - kLargePage) return ::operator new(bytes, kCacheLine);
  const size_t length = rounded_up(bytes, kLargePage);
  void* const block = ::operator new(length, kLargePageLine);
  const size_t in_large_pages = (bytes + kMostWasted) / kLargePage * kLargePage;
  ::madvise(block, in_large_pages, MADV_HUGEPAGE);  // what it refuses is paged as ever
  return block;
}

void free_large(void* block, size_t bytes) noexcept {
  if (bytes < kLeastPaged) return ::operator delete(block, kCacheLine);
  if (free_paged(block, bytes)) return;
  if (bytes < kLeastInLargePages) return ::operator delete(block, kCacheLine);
  ::operator delete(block, kLargePageLine);
}

}  // namespace raysfm
