#pragma once

#include <malloc.h>

namespace raysfm {

// Sets up the heap of the process for tracking; for programs, before they begin.
inline void prepare_heap() {
  // Large images come and go with every frame while small things stay: in one heap they would leave holes of
  // their size, 400 MiB of them over 40 panoramas of 29 megapixels.
  mallopt(M_MMAP_THRESHOLD, 4 << 20);
  // What one frame frees the next one takes: given back to the system in between, its pages would have to be
  // brought in anew. Of 3840 pixels across, half an image is 3 MiB.
  mallopt(M_TRIM_THRESHOLD, 4 << 20);
}

}  // namespace raysfm
