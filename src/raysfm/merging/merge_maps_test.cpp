#include "raysfm/merging/merge_maps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "raysfm/odometry/odometry.h"
#include "support/synth_maps.h"

namespace raysfm {
namespace {

using testing_support::saved_maps;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

// Once round a room.
const SynthViews& round() {
  static const SynthViews views = synth_views("room", "loop", 200);
  return views;
}

// The map that a run over frames [first, end) leaves; its sources tell the frames by their timestamps.
NamedMap mapped(const SynthViews& from, int first, int end, const std::string& name) {
  Odometry odometry(Rig{{small_camera()}}, {});
  for (int i = first; i < end; ++i) odometry.process(from.view(i, i - first));
  std::vector<Map> maps;
  odometry.finish(false, &maps);
  NamedMap out{name, saved_maps(std::move(maps), first)};
  EXPECT_EQ(out.map.worlds.size(), 1u) << name;
  return out;
}

double percent_of_path(const SavedWorld& world, const SynthViews& views) {
  Trajectory estimate;
  std::set<int> seen;  // a frame may be a key frame of two maps
  for (size_t k = 0; k < world.sources.size(); ++k) {
    const int frame = static_cast<int>(world.sources[k].timestamp);
    if (!seen.insert(frame).second) continue;
    estimate.timestamps.push_back(frame);
    estimate.world_from_cam.push_back(world.map.keyframes[k].rig_from_world.inverse());
  }
  return testing_support::percent_of_path(estimate, views);
}

size_t keyframes_of(const NamedMap& map) {
  return map.map.worlds[0].sources.size();
}

TEST(MergeMaps, TwoMapsThatOverlapAreOneWorld) {
  const NamedMap a = mapped(round(), 4, 50, "a"), b = mapped(round(), 25, 120, "b");
  const Result<MergedMaps> merged = merge_maps({a, b}, 0);
  ASSERT_TRUE(merged) << merged.error().message;
  ASSERT_EQ(merged->map.worlds.size(), 1u);
  const SavedWorld& world = merged->map.worlds[0];
  EXPECT_EQ(world.sources.size(), keyframes_of(a) + keyframes_of(b));
  EXPECT_LT(percent_of_path(world, round()), 0.2);
  ASSERT_EQ(merged->worlds.size(), 2u);
  EXPECT_EQ(merged->worlds[0].points, 0);
  EXPECT_EQ(merged->worlds[1].map, 1);
  EXPECT_EQ(merged->worlds[1].into, 0);
  EXPECT_GT(merged->worlds[1].points, 30);
  EXPECT_TRUE(check_saved_map(merged->map));
  // What both see is one: points seen by key frames of both maps.
  const auto shared = std::ranges::count_if(world.map.tracks, [&](const Track& t) {
    const auto is_of_a = [&](const TrackObservation& o) { return o.keyframe < int(keyframes_of(a)); };
    return t.triangulated && std::ranges::any_of(t.observations, is_of_a) &&
           !std::ranges::all_of(t.observations, is_of_a);
  });
  EXPECT_GE(shared, merged->worlds[1].points / 2);
}

// The third sees both of those before it, which do not see each other.
TEST(MergeMaps, AMapBetweenTwoOthersTiesThemTogether) {
  const NamedMap a = mapped(round(), 4, 50, "a"), b = mapped(round(), 90, 130, "b"),
                 between = mapped(round(), 25, 120, "between");
  const Result<MergedMaps> apart = merge_maps({a, b}, 0);
  ASSERT_TRUE(apart);
  ASSERT_EQ(apart->map.worlds.size(), 2u);
  // Nothing was brought together: not a bit has changed.
  for (const int w : {0, 1}) {
    const SavedWorld &was = (w == 0 ? a : b).map.worlds[0], &is = apart->map.worlds[w];
    ASSERT_EQ(is.map.tracks.size(), was.map.tracks.size());
    for (size_t t = 0; t < was.map.tracks.size(); ++t) {
      EXPECT_EQ(is.map.tracks[t].position, was.map.tracks[t].position);
    }
    for (size_t k = 0; k < was.sources.size(); ++k) {
      EXPECT_EQ(is.sources[k].timestamp, was.sources[k].timestamp);
      EXPECT_EQ(is.map.keyframes[k].frame, was.map.keyframes[k].frame);
      EXPECT_EQ(is.map.keyframes[k].rig_from_world.translation,
                was.map.keyframes[k].rig_from_world.translation);
    }
  }
  const Result<MergedMaps> merged = merge_maps({a, b, between}, 0);
  ASSERT_TRUE(merged);
  ASSERT_EQ(merged->map.worlds.size(), 1u);
  for (const MergedWorld& world : merged->worlds) EXPECT_EQ(world.into, 0);
  EXPECT_EQ(merged->map.worlds[0].sources.size(), keyframes_of(a) + keyframes_of(b) + keyframes_of(between));
  EXPECT_LT(percent_of_path(merged->map.worlds[0], round()), 0.3);
  EXPECT_TRUE(check_saved_map(merged->map));
}

// A calibration that was refined on other footage is the same camera; the map goes over to that of the first.
TEST(MergeMaps, CamerasMayDifferByWhatARefinementChanges) {
  const NamedMap a = mapped(round(), 4, 50, "a");
  const auto with_focal_length = [&](double factor) {
    Camera camera = small_camera();
    auto p = std::get<Radtan>(camera.model).parameters();
    p[0] *= factor;
    p[1] *= factor;
    camera.model = Radtan::from_parameters(p);
    NamedMap b = mapped(round(), 25, 120, "b");
    b.map.rig = Rig{{camera}};
    return b;
  };
  const Result<MergedMaps> merged = merge_maps({a, with_focal_length(1.005)}, 0);
  ASSERT_TRUE(merged) << merged.error().message;
  EXPECT_EQ(merged->map.worlds.size(), 1u);
  EXPECT_LT(percent_of_path(merged->map.worlds[0], round()), 0.2);
  const Result<MergedMaps> other = merge_maps({a, with_focal_length(1.2)}, 0);
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(other.error().message.find("b: camera 0 is another one"), std::string::npos);
}

TEST(MergeMaps, OtherCamerasAreRefused) {
  const NamedMap a{"a", {{{small_camera(), small_camera()}}, {}}};
  NamedMap b = a;
  b.name = "b";
  b.map.rig.cameras.pop_back();
  EXPECT_NE(merge_maps({a, b}, 0).error().message.find("1 cameras; allowed: as many as a has, 2"),
            std::string::npos);
  b = a;
  b.map.rig.cameras[1].width += 2;
  EXPECT_FALSE(merge_maps({a, b}, 0));
  b = a;
  b.map.rig.cameras[1].rig_from_cam.translation.x() = 0.1;
  EXPECT_FALSE(merge_maps({a, b}, 0));
}

}  // namespace
}  // namespace raysfm
