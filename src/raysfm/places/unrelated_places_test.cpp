// Views of places that have nothing to do with each other are not taken for one another.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>

#include "raysfm/core/random.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/places/place_matcher.h"
#include "support/described_map.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::described_map;
using testing_support::film;
using testing_support::PanelWorld;
using testing_support::shared_data;
using testing_support::true_pose;
using testing_support::TrueMap;

// Beyond it a place counts as seen again (place_memory.cpp), and how far unrelated ones must stay away.
constexpr double kSignificant = -20, kSignificantEnd = -27, kMargin = 8;

// What all pairs came to.
struct Tally {
  int pairs = 0, poses = 0;
  double least = 0;  // log10_false_alarms

  void add(const std::optional<RecognisedPlace>& place) {
    ++pairs;
    if (!place) return;
    ++poses;
    least = std::min(least, place->log10_false_alarms);
  }
  void expect_none_is_near(double significant = kSignificant) const {
    testing::Test::RecordProperty("pairs", pairs);
    testing::Test::RecordProperty("poses", poses);
    testing::Test::RecordProperty("least_log10_false_alarms", std::to_string(least));
    EXPECT_GT(least, significant + kMargin) << poses << " poses in " << pairs << " pairs";
  }
};

TEST(UnrelatedPlaces, RenderedWorldsAreNotTakenForOneAnother) {
  constexpr int kWorlds = 40;
  std::deque<TrueMap> maps;
  std::vector<DescribedCorners> seen;
  Describer describer;
  for (uint64_t seed = 1000; seed < 1000 + 10 * kWorlds; seed += 10) {
    maps.push_back(described_map(PanelWorld(seed), 1));
    const TrackingRig& rig = maps.back().rig;
    seen.push_back(describe_corners(*film(PanelWorld(seed), rig.camera(0), true_pose(rig, 1), 1), describer));
  }
  Tally tally;
  for (int a = 0; a < kWorlds; ++a) {
    PlaceMatcher matcher(maps[a].rig);
    EXPECT_LT(matcher.recognise(seen[a], maps[a].map, 0, 1, 1)->log10_false_alarms, -100);
    for (int b = 0; b < kWorlds; ++b) {
      if (a != b) tally.add(matcher.recognise(seen[b], maps[a].map, 0, 1, 1));
    }
  }
  tally.expect_none_is_near();
}

// A view of a real sequence, and a map of one key frame that it could be in.
struct RealView {
  int sequence = 0;
  DescribedCorners seen;
  Map map;
  TrackEnd end;  // of it
};

// Corners at distances that go up and down over the image, as those of surfaces do. All of them are in the
// end, as if those of several key frames had been taken together.
Map map_of(const View& view, const DescribedCorners& corners, const Camera& camera, TrackEnd* end) {
  Map map;
  MapKeyFrame& k = map.keyframes.emplace_back();
  for (size_t i = 0; i < corners.corners.size(); ++i) {
    const TrackPixel& c = corners.corners[i];
    Ray ray;
    if (!camera.ray(c.pixel.cast<double>(), &ray)) continue;
    const Eigen::Vector2f wave = 6.0f / static_cast<float>(view.cameras[0].width) * c.pixel;
    const double distance = 5 + 2 * std::sin(wave.x()) + std::cos(2 * wave.y());
    const int track = map.new_track();
    map.tracks[track].triangulated = map.tracks[track].had_position = true;
    map.tracks[track].position = camera.rig_from_cam * (ray.origin + distance * ray.direction);
    const int feature = k.add(0, c.pixel, c.octave, track);
    map.observe(track, 0, feature);
    end->corners.push_back({track, 0, c.octave, c.pixel});
    end->upright.push_back(corners.upright[i]);
    if (feature % 2 != 0) continue;  // as many as a key frame has
    k.described.push_back(feature);
    k.descriptors.push_back(corners.descriptors[i]);
  }
  return map;
}

// Every `step`-th of the first frames of a sequence.
void add_views(const std::filesystem::path& folder, int sequence, int count, int step,
               std::vector<RealView>* views, std::vector<Rig>* rigs) {
  Result<Input> input = open_input({folder.string()}, {.mono = true});
  ASSERT_TRUE(input) << input.error().message;
  ASSERT_TRUE(input->calibration) << folder;
  rigs->push_back({{input->calibration->cameras[0]}});
  HarrisDetector detector;
  Describer describer;
  for (int i = 0; i < count * step; ++i) {
    Result<std::optional<InputFrame>> frame = input->streams[0]->next();
    ASSERT_TRUE(frame) << frame.error().message;
    if (!*frame) break;
    if (i % step != 0) continue;
    View view;
    view.cameras.resize(1);
    view.cameras[0].image = std::move((*frame)->gray);
    detect(detector, {.max_features = 1200}, &view.cameras[0]);
    RealView& v = views->emplace_back();
    v.sequence = sequence;
    v.seen = describe_corners(view, describer);
    describe_upright(view, describer, &v.seen);
    v.map = map_of(view, v.seen, rigs->back().cameras[0], &v.end);
  }
}

const char* const kSequences[] = {"kitti07-mono", "kitti06-stereo", "tsukuba-mono", "redkitchen-handheld",
                                  "fr1-rpy",      "temple-ring",    "herzjesu-p8"};

class RealPlaces : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* folder : kSequences) RAYSFM_SKIP_WITHOUT_SHARED_DATA(folder);
    for (const char* folder : kSequences) {
      add_views(shared_data(folder), static_cast<int>(rigs_.size()), count(10), more_ ? 3 : 5, &views_,
                &rigs_);
    }
  }
  // By hand, with more views of each sequence.
  int count(int usual) const { return more_ ? std::atoi(more_) : usual; }

  const char* more_ = std::getenv("RAYSFM_UNRELATED_VIEWS");
  std::vector<RealView> views_;
  std::vector<Rig> rigs_;
};

TEST_F(RealPlaces, AreNotTakenForOneAnother) {
  Tally tally, of_ends;
  for (size_t r = 0; r < rigs_.size(); ++r) {
    const TrackingRig rig(rigs_[r]);
    PlaceMatcher matcher(rig);
    for (const RealView& here : views_) {
      if (here.sequence != static_cast<int>(r)) continue;
      for (const RealView& there : views_) {
        if (there.sequence == here.sequence) continue;
        tally.add(matcher.recognise(here.seen, there.map, 0, 1, 1));
        of_ends.add(matcher.recognise(here.seen, there.map, there.end, 1, 1));
      }
    }
  }
  EXPECT_GT(tally.pairs, 2000);
  tally.expect_none_is_near();
  of_ends.expect_none_is_near(kSignificantEnd);
}

// Every corner looks like one of the key frame, but like another one than that which is there: all matches
// are wrong, and there are many.
TEST_F(RealPlaces, AreNotKnownByMatchesThatAreAllWrong) {
  Tally tally;
  Rng rng(1);
  for (RealView& view : views_) {
    const TrackingRig rig(rigs_[view.sequence]);
    PlaceMatcher matcher(rig);
    const auto shuffle = [&](auto* descriptors) {
      for (size_t i = descriptors->size() - 1; i > 0; --i) {
        std::swap((*descriptors)[i], (*descriptors)[rng.index(static_cast<uint32_t>(i + 1))]);
      }
    };
    for (int trial = 0; trial < count(5); ++trial) {
      shuffle(&view.seen.descriptors);
      tally.add(matcher.recognise(view.seen, view.map, 0, 1, static_cast<uint64_t>(trial)));
      shuffle(&view.seen.upright);
      tally.add(matcher.recognise(view.seen, view.map, view.end, 1, static_cast<uint64_t>(trial)));
    }
  }
  EXPECT_GT(tally.pairs, 200);
  tally.expect_none_is_near();
}

}  // namespace
}  // namespace raysfm
