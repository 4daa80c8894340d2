#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>

#include "raysfm/odometry/odometry.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

// What a run held before its last call, in bytes, and what came of it.
struct HeldMemory {
  size_t slabs = 0, heap = 0;
  Reconstruction reconstruction;
};

// Along a corridor and back, several times.
HeldMemory run_forth_and_back(const SynthViews& corridor, int times) {
  const size_t slabs = slab_bytes_in_use(), heap = mallinfo2().uordblks;
  Odometry odometry(Rig{{small_camera()}}, {}, {});
  const int last = corridor.size() - 1;
  for (int i = 0; i < 2 * last * times; ++i) {
    const int place = i % (2 * last);
    odometry.process(corridor.view(std::min(place, 2 * last - place), i));
  }
  HeldMemory held{slab_bytes_in_use() - slabs, mallinfo2().uordblks - heap, {}};
  held.reconstruction = odometry.finish(false);
  return held;
}

// Once key frames are forgotten, what a longer video adds is what its map stands on and the poses of its
// frames, and hardly anything of it lies in the heap, where images come and go.
TEST(OdometryMemory, GrowsByTheMapAndThePosesOnly) {
  constexpr size_t kForgotten = 60;  // key frames of which images are kept
  // Bytes. An observation takes 15 in its key frame and 8 in its track, a point 56, a frame 450; of sizes
  // rounded up, and of tracks whose position was given up, there is a little more.
  // What a place is recognised by takes 36 bytes for each of up to 600 features, and 48 in the index, in
  // arrays that may be half empty; of 29 frames of this corridor about one is a new place, lap after lap, as
  // other points are followed.
  constexpr double kObservation = 28, kPoint = 100, kFrame = 600 + (36.0 + 2 * 48) * 600 / 29;
  const SynthViews corridor = synth_views("corridor", "drive", 30);
  const HeldMemory before = run_forth_and_back(corridor, 12), after = run_forth_and_back(corridor, 22);
  const Reconstruction &a = before.reconstruction, &b = after.reconstruction;
  ASSERT_EQ(a.segments.size(), 1u);
  ASSERT_EQ(b.segments.size(), 1u);
  ASSERT_GT(a.keyframes.size(), 2 * kForgotten);
  ASSERT_GT(b.keyframes.size(), a.keyframes.size() + kForgotten);
  const auto more = [](size_t longer, size_t shorter) {
    return static_cast<double>(longer) - static_cast<double>(shorter);
  };
  const double slabs = more(after.slabs, before.slabs), heap = more(after.heap, before.heap);
  EXPECT_LT(slabs, kObservation * more(b.observations.size(), a.observations.size()) +
                       kPoint * more(b.points.size(), a.points.size()) +
                       kFrame * more(b.frames.size(), a.frames.size()));
  // The views at hand, of which there are always as many, show more of a map that has more points.
  EXPECT_LT(heap, 0.5 * slabs);
}

}  // namespace
}  // namespace raysfm
