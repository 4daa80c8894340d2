#pragma once

#include <sys/resource.h>

#include <cstddef>
#include <cstdlib>

namespace raysfm {

// Most memory that the process has held so far, in MiB.
inline double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

// Whether so many bytes could be had now. Decoders of others call an image damaged that they found no room
// for; asking again what they had asked for tells the causes apart.
inline bool memory_left(size_t bytes) {
  // Volatile, or the compiler sees that nobody needs them.
  void* volatile block = std::malloc(bytes);
  std::free(block);
  return block != nullptr;
}

}  // namespace raysfm
