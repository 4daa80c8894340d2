#pragma once

#include <cstdint>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// The window of the local adjustment (LBA09 2.5): with key frames numbered from 0, after adding the last one
// the newest `free_cameras` move and the newest `window` are observed; as long as there are at most
// `global_until` key frames, all move and all are observed.
struct LocalBundleOptions {
  int free_cameras = 3;         // n, at least 1
  int window = 10;              // N, at least n + 2
  int global_until = 20;        // N_f, 0: never global
  bool may_free_scale = false;  // N may be n or n + 1, to see what becomes of it
};

// N < n + 2 leaves the frame or the scale at the end of the sequence free (LBA09 5.3, tables 4 and 5) and is
// refused with that reason, unless that is asked for.
Result<void> validate(const LocalBundleOptions& options);

struct LocalWindow {
  int first_observed = 0;  // key frames [first_observed, count) are in the adjustment
  int first_free = 0;      // key frames [first_free, count) move
};

// The window after `keyframe_count` >= 0 key frames. Valid options.
LocalWindow local_window(int keyframe_count, const LocalBundleOptions& options);

}  // namespace raysfm
