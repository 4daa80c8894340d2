// Odometry comes back to where it was.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/odometry/odometry.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::black_view;
using testing_support::flat_image;
using testing_support::labelled;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;
using testing_support::without_corners;

// Views of one world with their true poses; black ones between them have none.
struct Film {
  std::vector<ViewPtr> views;
  std::vector<std::optional<Rigid3>> world_from_rig;

  int size() const { return static_cast<int>(views.size()); }
  void add(const SynthViews& from, int first, int end) {
    for (int i = first; i < end; ++i) {
      views.push_back(from.view(i, size()));
      world_from_rig.push_back(from.world_from_rig[i]);
    }
  }
  void add_black(int count) {
    for (int i = 0; i < count; ++i) {
      views.push_back(black_view(320, 240, size()));
      world_from_rig.emplace_back();
    }
  }
};

struct MarksListener : TrackerObserver {
  std::vector<MarksFound> found;
  void marks_found(const MarksFound& e) override { found.push_back(e); }
};

struct PlaceListener : TrackerObserver {
  std::vector<PlaceSeenAgain> seen_again;
  std::vector<TrackLost> lost;
  void track_lost(const TrackLost& e) override { lost.push_back(e); }
  void place_seen_again(const PlaceSeenAgain& e) override { seen_again.push_back(e); }
};

Reconstruction run(const Film& film, const OdometryOptions& options = {}, const Rig& rig = {{small_camera()}},
                   TrackerObserver* observer = nullptr, const ViewMaker* maker = nullptr) {
  Odometry odometry(rig, options, observer, maker);
  for (const ViewPtr& view : film.views) odometry.process(view);
  return odometry.finish(false);
}

OdometryOptions without_loops() {
  OdometryOptions options;
  options.loops = false;
  return options;
}

void expect_posed_where_it_sees(const Reconstruction& r, const Film& film) {
  ASSERT_EQ(static_cast<int>(r.frames.size()), film.size());
  for (int i = 0; i < film.size(); ++i) {
    EXPECT_EQ(r.frames[i].world_from_rig.has_value(), film.world_from_rig[i].has_value())
        << i << ": " << r.frames[i].reason;
  }
}

// Of the frames of one segment, against the truth in one frame.
Evaluation error_of(const Reconstruction& r, const Film& film, int segment = 0,
                    Alignment alignment = Alignment::kSim3) {
  Trajectory estimate, truth;
  for (int i = 0; i < film.size(); ++i) {
    if (r.frames[i].segment != segment || !film.world_from_rig[i]) continue;
    estimate.timestamps.push_back(i);
    estimate.world_from_cam.push_back(*r.frames[i].world_from_rig);
    truth.timestamps.push_back(i);
    truth.world_from_cam.push_back(*film.world_from_rig[i]);
  }
  const Result<Evaluation> error = evaluate(estimate, truth, {.alignment = alignment});
  EXPECT_TRUE(error) << error.error().message;
  return error ? *error : Evaluation{};
}

// Once round a room, at a pace at which track is lost now and then, and slowly.
const SynthViews& quick_round() {
  static const SynthViews views = synth_views("room", "loop", 200);
  return views;
}
const SynthViews& slow_round() {
  static const SynthViews views = synth_views("room", "loop", 480);
  return views;
}

// One side of the room, then the other from where nothing of the first is seen, and on to the first.
Film two_sides() {
  Film film;
  film.add(quick_round(), 4, 50);
  film.add_black(6);
  film.add(quick_round(), 106, 200);
  film.add(quick_round(), 0, 40);
  return film;
}

bool identical(const Reconstruction& a, const Reconstruction& b) {
  const auto same_frame = [](const PosedFrame& f, const PosedFrame& g) {
    if (f.segment != g.segment || f.reason != g.reason || f.covariance != g.covariance) return false;
    return !f.world_from_rig || (f.world_from_rig->translation == g.world_from_rig->translation &&
                                 f.world_from_rig->rotation.coeffs() == g.world_from_rig->rotation.coeffs());
  };
  const auto same_point = [](const MapPoint& p, const MapPoint& q) { return p.position == q.position; };
  const auto same_closure = [](const Closure& c, const Closure& d) {
    return c.frame == d.frame && c.with_frame == d.with_frame && c.inliers == d.inliers &&
           c.joined_worlds == d.joined_worlds && c.correction == d.correction;
  };
  return std::ranges::equal(a.frames, b.frames, same_frame) &&
         std::ranges::equal(a.points, b.points, same_point) &&
         std::ranges::equal(a.closures, b.closures, same_closure);
}

TEST(OdometryPlaces, TheFirstPlaceIsFoundAgainAfterAGap) {
  Film film;
  film.add(quick_round(), 4, 40);
  film.add_black(10);
  film.add(quick_round(), 6, 22);
  const Reconstruction r = run(film);
  ASSERT_EQ(r.segments.size(), 1u);
  expect_posed_where_it_sees(r, film);
  EXPECT_LT(error_of(r, film).percent_of_path(), 0.3);
}

// A jump: of the map nothing is recognised, until another one is there that sees what was seen before the
// jump.
TEST(OdometryPlaces, AWorldThatSeesWhereTheOneBeforeEndedIsThatOne) {
  const ViewMaker maker({{0, {}, {.max_features = 600}}});
  for (const auto& [begin, end] : {std::pair(30, 56), {120, 140}}) {
    Film film;
    film.add(quick_round(), begin - 26, begin);
    film.add(quick_round(), end, end + 30);
    PlaceListener listener;
    const Reconstruction r = run(film, {}, {{small_camera()}}, &listener, &maker);
    const Reconstruction apart = run(film, without_loops(), {{small_camera()}}, nullptr, &maker);
    EXPECT_EQ(apart.segments.size(), 2u);
    ASSERT_EQ(r.segments.size(), 1u);
    expect_posed_where_it_sees(r, film);
    EXPECT_LT(error_of(r, film).percent_of_path(), 0.2);
    ASSERT_EQ(listener.lost.size(), 1u);
    EXPECT_NE(listener.lost[0].reason.find("points"), std::string::npos);
    EXPECT_FALSE(listener.lost[0].reason.starts_with("track lost")) << listener.lost[0].reason;
    ASSERT_EQ(listener.seen_again.size(), 1u);
    const Closure& closure = listener.seen_again[0].closure;
    EXPECT_TRUE(closure.joined_worlds);
    EXPECT_GE(closure.with_frame, 20);
    EXPECT_LT(closure.with_frame, 26);
    EXPECT_GE(closure.frame, 26);
    EXPECT_LT(closure.frame, 36);
    EXPECT_GT(closure.inliers, 50);
    EXPECT_TRUE(identical(r, run(film, {}, {{small_camera()}}, nullptr, &maker)));
  }
}

// Back from where little of the map is seen to where a view is recognised: the frames until then are posed
// from there.
TEST(OdometryPlaces, FramesBeforeTrackIsFoundAgainArePosedAfterwards) {
  Film film;
  film.add(quick_round(), 4, 30);
  film.add_black(4);
  for (int i = 52; i >= 24; --i) film.add(quick_round(), i, i + 1);
  struct : TrackerObserver {
    std::vector<int> frames;
    void track_found(const TrackFound& e) override { frames.push_back(e.frame); }
  } found;
  const Reconstruction r = run(film, {}, {{small_camera()}}, &found);
  ASSERT_EQ(r.segments.size(), 1u);
  ASSERT_EQ(found.frames.size(), 1u);
  EXPECT_GT(found.frames[0], 30);
  expect_posed_where_it_sees(r, film);
  EXPECT_LT(error_of(r, film).percent_of_path(), 0.3);
}

// More than 60 key frames later, when no image of the first place is there.
TEST(OdometryPlaces, ALoopIsClosed) {
  Film film;
  film.add(slow_round(), 4, 480);
  film.add(slow_round(), 0, 40);
  PlaceListener listener;
  const Reconstruction r = run(film, {}, {{small_camera()}}, &listener), open = run(film, without_loops());
  expect_posed_where_it_sees(r, film);
  ASSERT_EQ(r.segments.size(), 1u);
  EXPECT_GT(r.keyframes.size(), 80u);
  ASSERT_EQ(r.closures.size(), 1u);
  const Closure& closure = r.closures[0];
  EXPECT_FALSE(closure.joined_worlds);
  EXPECT_LT(closure.with_frame, 40);
  EXPECT_GT(closure.frame, 440);
  EXPECT_GT(closure.inliers, 50);
  ASSERT_EQ(listener.seen_again.size(), 1u);
  EXPECT_EQ(listener.seen_again[0].closure.frame, closure.frame);
  EXPECT_EQ(listener.seen_again[0].joined_world, -1);

  EXPECT_TRUE(open.closures.empty());
  ASSERT_EQ(open.segments.size(), 1u);
  const Evaluation error = error_of(r, film), drifted = error_of(open, film);
  EXPECT_LT(error.percent_of_path(), 0.03);
  EXPECT_LT(error.ate.rmse, 0.5 * drifted.ate.rmse);
  EXPECT_LT(error.ate.max, 0.5 * drifted.ate.max);
  EXPECT_LT(r.rms_reprojection_px, 1.4 * open.rms_reprojection_px);
}

// Four times round the room, and along its first side once more after a gap.
constexpr int kRound = 480, kRounds = 4, kFirst = 4;
constexpr std::pair kAfterGap = {20, 60};
const Film& many_rounds() {
  static const Film film = [] {
    Film rounds;
    for (int i = 0; i < kRounds; ++i) rounds.add(slow_round(), i == 0 ? kFirst : 0, kRound);
    rounds.add_black(6);
    rounds.add(slow_round(), kAfterGap.first, kAfterGap.second);
    return rounds;
  }();
  return film;
}

// A map that keeps all of the first round, and little of what it sees again.
OdometryOptions few_kept() {
  OdometryOptions options;
  options.keep_all_until = 100;
  return options;
}

struct KeyFrameListener : TrackerObserver {
  std::array<int, kRounds + 1> most = {};  // key frames that the world had in each round
  void keyframe_added(const KeyFrameAdded& e) override {
    int& of_round = most[e.frame / kRound];
    of_round = std::max(of_round, e.keyframe + 1);
  }
};

struct FewKept {
  KeyFrameListener listener;
  std::vector<Map> maps;
  Reconstruction result;
};
const FewKept& many_rounds_few_kept() {
  static const FewKept run = [] {
    FewKept few;
    Odometry odometry({{small_camera()}}, few_kept(), &few.listener);
    for (const ViewPtr& view : many_rounds().views) odometry.process(view);
    few.result = odometry.finish(false, &few.maps);
    return few;
  }();
  return run;
}

// A further round makes the map larger by less than half of what the first one brought: a tenth of the second
// look stays, and what sees too much that is new.
TEST(OdometryPlaces, AMapHardlyGrowsWhereAllWasSeenBefore) {
  const Film& film = many_rounds();
  const Reconstruction &r = many_rounds_few_kept().result, whole = run(film);
  expect_posed_where_it_sees(r, film);
  ASSERT_EQ(r.segments.size(), 1u);
  const auto& most = many_rounds_few_kept().listener.most;
  ASSERT_GT(most[0], 80);
  EXPECT_LT(most[3], most[2] + most[0] / 2);
  EXPECT_LT(r.keyframes.size(), 0.75 * whole.keyframes.size());
  for (size_t k = 1; k < r.keyframes.size(); ++k) {
    EXPECT_LT(r.keyframes[k - 1].frame, r.keyframes[k].frame);
  }
  const Evaluation error = error_of(r, film), of_whole = error_of(whole, film);
  EXPECT_LT(error.ate.rmse, 1.1 * of_whole.ate.rmse);
  EXPECT_LT(error.ate.max, 1.1 * of_whole.ate.max);
  EXPECT_LT(error.rpe.trans, 1.1 * of_whole.rpe.trans);
  EXPECT_LT(r.rms_reprojection_px, 1.1 * whole.rms_reprojection_px);
}

TEST(OdometryPlaces, PlacesAndMapGoTogetherAfterSecondLooksHaveGone) {
  const Film& film = many_rounds();
  const Reconstruction& r = many_rounds_few_kept().result;
  // Whether the map is off once more after it was closed is chance.
  ASSERT_FALSE(r.closures.empty());
  for (const Closure& c : r.closures) {
    const Rigid3 here = *film.world_from_rig[c.frame], there = *film.world_from_rig[c.with_frame];
    EXPECT_LT((here.translation - there.translation).norm(), 0.5) << c.frame << " " << c.with_frame;
  }
  // Found again after the gap, by a place of which no image is at hand, and where it was in the first round.
  EXPECT_EQ(r.frames.back().segment, 0);
  const auto at = [&](int frame) { return r.frames[frame].world_from_rig->translation; };
  double round = 0;
  for (int i = 1; i < kRound; ++i) round += (at(i) - at(i - 1)).norm();
  for (int i = film.size() - 10; i < film.size(); ++i) {
    const int then = i - film.size() + kAfterGap.second - kFirst;
    EXPECT_LT((at(i) - at(then)).norm(), 0.001 * round) << i;
  }
  const auto& maps = many_rounds_few_kept().maps;
  ASSERT_EQ(maps.size(), 1u);
  const Map& map = maps[0];
  for (int t = 0; t < static_cast<int>(map.tracks.size()); ++t) {
    for (const TrackObservation& o : map.tracks[t].observations) {
      ASSERT_LT(o.keyframe, static_cast<int>(map.keyframes.size()));
      ASSERT_LT(o.feature, map.keyframes[o.keyframe].size());
      ASSERT_EQ(map.keyframes[o.keyframe].tracks[o.feature], t);
    }
  }
}

TEST(OdometryPlaces, WorldsThatShowOnePlaceAreJoined) {
  const Film film = two_sides();
  PlaceListener listener;
  const Reconstruction r = run(film, {}, {{small_camera()}}, &listener), apart = run(film, without_loops());
  EXPECT_EQ(apart.segments.size(), 2u);
  EXPECT_TRUE(apart.closures.empty());
  ASSERT_EQ(r.segments.size(), 1u);
  ASSERT_EQ(r.starts.size(), 1u);
  EXPECT_EQ(r.segments[0].reason, "end of input");
  EXPECT_EQ(r.segments[0].last, film.size() - 1);
  ASSERT_FALSE(r.closures.empty());
  EXPECT_TRUE(r.closures[0].joined_worlds);
  EXPECT_LT(r.closures[0].with_frame, 46);
  ASSERT_FALSE(listener.seen_again.empty());
  EXPECT_EQ(listener.seen_again[0].world, 0);
  EXPECT_EQ(listener.seen_again[0].joined_world, 1);
  // Both sides in one frame; not much worse than each alone.
  EXPECT_LT(error_of(r, film).percent_of_path(), 0.06);
  EXPECT_LT(error_of(r, film).ate.max, 0.03);
  for (int i = 0; i < film.size(); ++i) {
    EXPECT_EQ(r.frames[i].world_from_rig.has_value(), apart.frames[i].world_from_rig.has_value()) << i;
  }
  for (const MapPoint& p : r.points) EXPECT_EQ(p.segment, 0);
  for (size_t k = 1; k < r.keyframes.size(); ++k) {
    EXPECT_LT(r.keyframes[k - 1].frame, r.keyframes[k].frame);
  }
  // Matches that are wrong by little are left as they are.
  EXPECT_LT(r.rms_reprojection_px, 1.7 * apart.rms_reprojection_px);
}

// Corridors of the same bricks and boards, where an end may be seen from another's beginning too. In those
// of the last one a wall of it is.
TEST(OdometryPlaces, UnrelatedWorldsStayApart) {
  struct Corridors {
    uint64_t first_seed;
    int count, frames, black;
  };
  const ViewMaker maker({{0, {}, {.max_features = 600}}});
  for (const auto& [first_seed, count, frames, black] :
       {Corridors{0, 4, 24, 3}, Corridors{0, 4, 24, 0}, Corridors{104, 2, 40, 3}}) {
    Film film;
    for (int i = 0; i < count; ++i) {
      film.add(synth_views("corridor", "drive", frames, first_seed + static_cast<uint64_t>(i)), 0, frames);
      film.add_black(black);
    }
    const Reconstruction r = run(film, {}, {{small_camera()}}, nullptr, &maker);
    ASSERT_EQ(static_cast<int>(r.segments.size()), count) << first_seed << " " << black;
    EXPECT_TRUE(r.closures.empty());
    for (int i = 0; i < film.size(); ++i) {
      if (r.frames[i].world_from_rig) {
        EXPECT_EQ(r.frames[i].segment, i / (frames + black)) << i;
      }
    }
    for (int s = 0; s < count; ++s) EXPECT_LT(error_of(r, film, s).percent_of_path(), 0.5) << s;
  }
}

// Whether corners are there before they are needed or not, and run after run.
TEST(OdometryPlaces, TheResultDependsOnTheViewsAlone) {
  const Film film = two_sides();
  const ViewMaker maker({{0, {}, {.max_features = 600}}});
  Film late = film;
  for (ViewPtr& view : late.views) view = without_corners(*view);
  ASSERT_FALSE(late.views[0]->detected());
  const Reconstruction first = run(film);
  ASSERT_FALSE(first.closures.empty());
  EXPECT_TRUE(identical(first, run(film)));
  EXPECT_TRUE(identical(first, run(late, {}, {{small_camera()}}, nullptr, &maker)));
}

// The unit of length may change on the way, and frames between key frames go with them. What is left of the
// error is a matter of where steps end: the whole at once ends sooner, and is nearer the truth by a fifth.
TEST(OdometryPlaces, PartByPartEverythingIsAdjustedAboutAsWellAsAtOnce) {
  Film film;
  film.add(slow_round(), 4, 300);
  const auto adjusted = [&](FinalAdjustment how, uint64_t seed) {
    OdometryOptions options;
    options.final = how;
    options.seed = seed;
    Odometry odometry({{small_camera()}}, options);
    for (const ViewPtr& view : film.views) odometry.process(view);
    return odometry.finish(true);
  };
  constexpr int kSeeds = 3;
  double error_at_once = 0, error_by_parts = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const Reconstruction at_once = adjusted(FinalAdjustment::kGlobal, seed),
                         by_parts = adjusted(FinalAdjustment::kHierarchical, seed);
    ASSERT_EQ(by_parts.segments.size(), 1u);
    EXPECT_GT(by_parts.keyframes.size(), 40u);  // several parts
    EXPECT_FALSE(identical(at_once, by_parts));
    error_at_once += error_of(at_once, film).ate.rmse / kSeeds;
    error_by_parts += error_of(by_parts, film).ate.rmse / kSeeds;
    EXPECT_LT(error_of(by_parts, film).rpe.trans, 1.1 * error_of(at_once, film).rpe.trans);
    EXPECT_LT(by_parts.rms_reprojection_px, 1.02 * at_once.rms_reprojection_px);
  }
  EXPECT_LT(error_by_parts, 1.3 * error_at_once);
  // By a loss of a whole pixel 0.0038 and 0.0039.
  EXPECT_LT(error_at_once, 0.003);
  EXPECT_LT(error_by_parts, 0.0035);
}

// The state after so many views of a film, and the film's views that it refers to.
struct Broken {
  std::string state;
  std::map<int, ViewPtr> views;
};

Broken broken_off(const Film& film, int views, const OdometryOptions& options = {}) {
  Odometry odometry({{small_camera()}}, options);
  for (int i = 0; i < views; ++i) odometry.process(film.views[i]);
  StateWriter writer;
  odometry.write_state(writer);
  Broken out{writer.content(), {}};
  for (const auto& [frame, detected] : writer.views()) {
    EXPECT_LT(frame, views);
    out.views[frame] = film.views[frame];
  }
  return out;
}

void expect_same_after_a_break(const Film& film, const Reconstruction& whole, int views,
                               const OdometryOptions& options = {}) {
  const Broken broken = broken_off(film, views, options);
  Odometry odometry({{small_camera()}}, options);
  StateReader reader(broken.state, broken.views);
  ASSERT_TRUE(odometry.read_state(reader)) << views;
  EXPECT_EQ(odometry.frames(), views);
  for (int i = views; i < film.size(); ++i) odometry.process(film.views[i]);
  EXPECT_TRUE(identical(whole, odometry.finish(false))) << views;
}

// While it starts, tracks, is lost, and after worlds were joined.
TEST(OdometryPlaces, ItGoesOnFromItsStateWithTheSameResult) {
  const Film film = two_sides();
  const Reconstruction whole = run(film);
  ASSERT_FALSE(whole.closures.empty());
  for (const int views : {1, 5, 30, 49, 55, 100, film.size() - 20, film.size()}) {
    expect_same_after_a_break(film, whole, views);
  }
}

// After some key frames of second looks have gone, and before others do.
TEST(OdometryPlaces, ItGoesOnWithoutSecondLooksWithTheSameResult) {
  expect_same_after_a_break(many_rounds(), many_rounds_few_kept().result, 3 * kRound, few_kept());
}

TEST(OdometryPlaces, ItGoesOnInTheMiddleOfATurnWithTheSameResult) {
  Film film;
  const SynthViews pan = synth_views("corridor", "pan", 120);
  film.add(pan, 0, 120);
  const Reconstruction whole = run(film);
  int broken = 0;
  for (int i = 0; i < film.size(); ++i) {
    if (!whole.frames[i].place_held || i % 4 != 0) continue;
    expect_same_after_a_break(film, whole, i);
    ++broken;
  }
  EXPECT_GT(broken, 2);
}

TEST(OdometryPlaces, AStateThatIsNotWholeIsRefused) {
  Broken broken = broken_off(two_sides(), 30);
  const auto is_read = [&](std::string_view state) {
    Odometry odometry({{small_camera()}}, {});
    StateReader reader(state, broken.views);
    return odometry.read_state(reader);
  };
  ASSERT_TRUE(is_read(broken.state));
  for (int i = 0; i < 200; ++i) {
    EXPECT_FALSE(is_read(std::string_view(broken.state).substr(0, broken.state.size() * i / 200))) << i;
  }
  EXPECT_FALSE(is_read(broken.state + "x"));
  broken.views.erase(broken.views.begin());
  EXPECT_FALSE(is_read(broken.state));
}

// After a jump the view shows less than a third of what the key frame that it was found by had seen.
TEST(OdometryPlaces, TrackThatWasFoundAgainGoesOn) {
  for (const int jump : {3, 5, 7, 9}) {
    SCOPED_TRACE(jump);
    Film film;
    film.add(quick_round(), 4, 44);
    film.add_black(2);
    film.add(quick_round(), 44 + jump, 64 + jump);
    const Reconstruction r = run(film, without_loops());
    ASSERT_EQ(r.segments.size(), 1u);
    expect_posed_where_it_sees(r, film);
    EXPECT_LT(error_of(r, film).percent_of_path(), 0.3);
  }
}

// Along a corridor with a label over a sixth of every image, or of those from a frame on.
Film labelled_corridor(int first) {
  Film film;
  film.add(labelled(synth_views("corridor", "drive", 80), first), 0, 80);
  return film;
}

// Its corners stay in their place, as those of points infinitely far do, and a map with them is wrong.
TEST(OdometryMarks, WhatMovesWithTheCameraIsLeftOut) {
  for (const int first : {0, 30}) {
    SCOPED_TRACE(first);
    const Film film = labelled_corridor(first);
    MarksListener listener;
    const Reconstruction r = run(film, {}, {{small_camera()}}, &listener);
    ASSERT_FALSE(listener.found.empty());
    EXPECT_GE(listener.found[0].frame, first);
    EXPECT_NEAR(listener.found.back().part, 1.0 / 6, 0.08);
    ASSERT_EQ(r.segments.size(), 1u);
    expect_posed_where_it_sees(r, film);
    EXPECT_LT(error_of(r, film).percent_of_path(), 0.1);
  }
}

TEST(OdometryMarks, ItGoesOnFromItsStateWithTheSameResult) {
  const Film film = labelled_corridor(0);
  MarksListener listener;
  const Reconstruction whole = run(film, {}, {{small_camera()}}, &listener);
  ASSERT_FALSE(listener.found.empty());
  const int found = listener.found[0].frame;
  for (const int views : {5, found - 3, found + 1, found + 10, film.size()}) {
    expect_same_after_a_break(film, whole, views);
  }
}

// Little light, and the noise of a camera that makes up for it.
SynthViews at_night(const SynthViews& views) {
  SynthViews out{{}, views.world_from_rig, views.timestamps};
  for (int i = 0; i < views.size(); ++i) {
    Rng rng(1, i);
    GrayImage image(views.images[i].width(), views.images[i].height());
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        image.row(y)[x] = testing_support::to_grey(10 + 0.4 * views.images[i].row(y)[x] + 6 * rng.normal());
      }
    }
    out.images.push_back(std::move(image));
  }
  return out;
}

TEST(OdometryAtNight, NoiseIsNotFollowed) {
  Film film;
  film.add(at_night(synth_views("corridor", "drive", 60)), 0, 60);
  const Reconstruction r = run(film);
  ASSERT_EQ(r.segments.size(), 1u);
  expect_posed_where_it_sees(r, film);
  EXPECT_LT(error_of(r, film).percent_of_path(), 0.2);
}

ViewPtr stereo_view(GrayImage left, GrayImage right, int frame) {
  auto view = std::make_shared<View>();
  view->frame = frame;
  view->timestamp = 0.1 * frame;
  view->cameras.resize(2);
  view->cameras[0].image = std::move(left);
  view->cameras[1].image = std::move(right);
  HarrisDetector detector;
  for (CameraView& camera : view->cameras) {
    detect(detector, HarrisOptions{.max_features = 600, .mask = {}}, &camera);
  }
  return view;
}

// Two cameras side by side tell metres, in both worlds and in the joined one.
TEST(OdometryPlaces, JoinedWorldsOfAStereoRigAreInMetres) {
  Rig rig{{small_camera(), small_camera()}};
  rig.cameras[1].rig_from_cam.translation = {0.2, 0, 0};
  ThreadPool pool(0);
  synth::SequenceOptions options;
  options.world = "room";
  options.motion = "loop";
  options.frames = 200;
  options.render.samples = 1;
  auto sequence = synth::Sequence::create(options, rig, pool);
  ASSERT_TRUE(sequence) << sequence.error().message;
  Film film;
  const auto add = [&](int first, int end) {
    for (int i = first; i < end; ++i) {
      film.views.push_back(stereo_view(synth::to_gray((*sequence)->render(i, 0)),
                                       synth::to_gray((*sequence)->render(i, 1)), film.size()));
      film.world_from_rig.push_back((*sequence)->world_from_rig(i));
    }
  };
  add(4, 40);
  for (int i = 0; i < 5; ++i) {
    film.views.push_back(stereo_view(flat_image(320, 240, 0), flat_image(320, 240, 0), film.size()));
    film.world_from_rig.emplace_back();
  }
  add(120, 200);
  add(0, 30);
  const Reconstruction r = run(film, {}, rig);
  ASSERT_EQ(r.segments.size(), 1u);
  ASSERT_FALSE(r.closures.empty());
  EXPECT_TRUE(r.closures[0].joined_worlds);
  EXPECT_TRUE(r.metric_scale);
  EXPECT_NEAR(error_of(r, film).truth_from_estimate.scale, 1, 0.01);
  EXPECT_LT(error_of(r, film, 0, Alignment::kSe3).percent_of_path(), 0.2);
}

}  // namespace
}  // namespace raysfm
