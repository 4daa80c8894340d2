#pragma once

#include <malloc.h>
#include <sys/resource.h>

namespace raysfm {

// Most memory that the process has held so far, in MiB.
inline double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

// Gives what was freed back to the system, where it lies in whole pages.
inline void return_freed_memory() {
  malloc_trim(0);
}

}  // namespace raysfm
