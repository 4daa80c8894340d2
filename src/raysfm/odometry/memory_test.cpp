#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <vector>

#include "raysfm/odometry/odometry.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

// What a run held at a time, in bytes, and what there was of it.
struct HeldMemory {
  size_t slabs = 0, heap = 0;
  size_t segments = 0, keyframes = 0, observations = 0, points = 0, frames = 0;
};

// Along a corridor and back, several times: what is held after each of `times`.
std::vector<HeldMemory> run_forth_and_back(const SynthViews& corridor, const std::vector<int>& times) {
  const size_t slabs = slab_bytes_in_use(), heap = mallinfo2().uordblks;
  std::vector<HeldMemory> held;
  held.reserve(times.size());
  Odometry odometry(Rig{{small_camera()}}, {}, {});
  const int last = corridor.size() - 1;
  for (int i = 0; held.size() < times.size(); ++i) {
    const int place = i % (2 * last);
    odometry.process(corridor.view(std::min(place, 2 * last - place), i));
    if (i + 1 < 2 * last * times[held.size()]) continue;
    HeldMemory& now = held.emplace_back(slab_bytes_in_use() - slabs, mallinfo2().uordblks - heap);
    const Reconstruction r = odometry.snapshot();
    now.segments = r.segments.size();
    now.keyframes = r.keyframes.size();
    now.observations = r.observations.size();
    now.points = r.points.size();
    now.frames = r.frames.size();
  }
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
  const std::vector<HeldMemory> held = run_forth_and_back(corridor, {12, 30});
  const HeldMemory &before = held[0], &after = held[1];
  ASSERT_EQ(after.segments, 1u);
  ASSERT_GT(before.keyframes, 2 * kForgotten);
  ASSERT_GT(after.keyframes, before.keyframes + kForgotten);
  const auto more = [](size_t longer, size_t shorter) {
    return static_cast<double>(longer) - static_cast<double>(shorter);
  };
  const double slabs = more(after.slabs, before.slabs), heap = more(after.heap, before.heap);
  EXPECT_LT(slabs, kObservation * more(after.observations, before.observations) +
                       kPoint * more(after.points, before.points) +
                       kFrame * more(after.frames, before.frames));
  // The views at hand, of which there are always as many, show more of a map that has more points.
  EXPECT_LT(heap, 0.5 * slabs);
}

}  // namespace
}  // namespace raysfm
