#include "raysfm/odometry/odometry.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <set>
#include <span>

#include "raysfm/eval/consistency.h"
#include "raysfm/eval/trajectory_error.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::as_view;
using testing_support::black_view;
using testing_support::corridor;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;
using testing_support::without_corners;

// Views of several scenes in a row, each with the number of its scene (-1: black) and the true pose in it.
struct Footage {
  std::vector<ViewPtr> views;
  std::vector<int> scene;
  std::vector<Rigid3> world_from_rig;

  int size() const { return static_cast<int>(views.size()); }
  void add(const SynthViews& from, int index, int scene_number) {
    views.push_back(from.view(index, size()));
    scene.push_back(scene_number);
    world_from_rig.push_back(from.world_from_rig[index]);
  }
  void add_all(const SynthViews& from, int scene_number) {
    for (int i = 0; i < from.size(); ++i) add(from, i, scene_number);
  }
  void add_black(int count) {
    for (int i = 0; i < count; ++i) {
      views.push_back(black_view(320, 240, size()));
      scene.push_back(-1);
      world_from_rig.emplace_back();
    }
  }
};

// 2.4 m round a board.
const SynthViews& board() {
  static const SynthViews views = synth_views("board", "orbit", 24);
  return views;
}

Footage one_scene(const SynthViews& views) {
  Footage input;
  input.add_all(views, 0);
  return input;
}

Reconstruction run(const Footage& input, const OdometryOptions& options = {}, bool final_global = false,
                   TrackerObserver* observer = nullptr) {
  Odometry odometry(Rig{{small_camera()}}, options, observer);
  for (const ViewPtr& view : input.views) odometry.process(view);
  EXPECT_EQ(odometry.frames(), input.size());
  return odometry.finish(final_global);
}

struct LateRun {
  Reconstruction reconstruction;
  std::vector<uint8_t> detected;  // by frame: corners were detected while it was processed
};

// The same as run() for views that come without corners.
LateRun run_without_corners(const Footage& input) {
  const ViewMaker maker({{0, {}, {.max_features = 600}}});
  Odometry odometry(Rig{{small_camera()}}, {}, {}, &maker);
  LateRun out;
  for (const ViewPtr& view : input.views) {
    odometry.process(without_corners(*view));
    out.detected.push_back(odometry.timings().detect.samples_ms.back() > 0);
  }
  out.reconstruction = odometry.finish(false);
  return out;
}

// Error of the frames of one segment that show one scene.
Result<Evaluation> error_of(const Reconstruction& r, const Footage& input, int segment, int scene) {
  Trajectory estimate, truth;
  for (int i = 0; i < input.size(); ++i) {
    if (r.frames[i].segment != segment || input.scene[i] != scene) continue;
    estimate.timestamps.push_back(i);
    estimate.world_from_cam.push_back(*r.frames[i].world_from_rig);
    truth.timestamps.push_back(i);
    truth.world_from_cam.push_back(input.world_from_rig[i]);
  }
  return evaluate(estimate, truth, {});
}

void expect_small_error(const Reconstruction& r, const Footage& input, int segment, int scene,
                        double percent = 0.5) {
  const Result<Evaluation> error = error_of(r, input, segment, scene);
  ASSERT_TRUE(error) << error.error().message;
  EXPECT_LT(error->percent_of_path(), percent);
  EXPECT_LT(error->ate.max, 4 * percent / 100 * error->length);
  EXPECT_LT(error->rpe.rot_deg, 0.15);
}

// What holds for every reconstruction.
void expect_sound(const Reconstruction& r, const Footage& input) {
  ASSERT_EQ(static_cast<int>(r.frames.size()), input.size());
  ASSERT_EQ(r.starts.size(), r.segments.size());
  std::map<int, std::pair<int, int>> extent;  // of each segment
  for (int i = 0; i < input.size(); ++i) {
    const PosedFrame& f = r.frames[i];
    EXPECT_EQ(f.timestamp, input.views[i]->timestamp);
    EXPECT_EQ(f.world_from_rig.has_value(), f.segment >= 0) << i;
    EXPECT_EQ(f.world_from_rig.has_value(), f.reason.empty()) << i << ": " << f.reason;
    if (!f.world_from_rig) continue;
    extent.try_emplace(f.segment, i, i).first->second.second = i;
    EXPECT_NEAR(f.world_from_rig->rotation.norm(), 1, 1e-9);
    EXPECT_TRUE(f.world_from_rig->translation.allFinite());
    EXPECT_EQ(Eigen::LLT<Matrix6d>(f.covariance).info(), Eigen::Success) << i;
    EXPECT_GT(f.covariance.diagonal().minCoeff(), 0) << i;
  }
  ASSERT_EQ(extent.size(), r.segments.size());
  for (const auto& [segment, range] : extent) {
    ASSERT_LT(segment, static_cast<int>(r.segments.size()));
    EXPECT_EQ(r.segments[segment].first, range.first);
    EXPECT_EQ(r.segments[segment].last, range.second);
    EXPECT_FALSE(r.segments[segment].reason.empty());
  }
}

// Key frames, observations and points belong together, and the rms is theirs.
void expect_consistent_map(const Reconstruction& r) {
  double squares = 0;
  int end = 0;
  for (const KeyFrame& k : r.keyframes) {
    EXPECT_EQ(k.first_observation, end);
    end = k.last_observation;
    const PosedFrame& frame = r.frames[k.frame];
    ASSERT_TRUE(frame.world_from_rig);
    for (int o = k.first_observation; o < k.last_observation; ++o) {
      const MapPoint& point = r.points[r.observations[o].point];
      EXPECT_EQ(point.segment, frame.segment);
      Eigen::Vector2d pixel;
      ASSERT_TRUE(r.rig.cameras[0].project(frame.world_from_rig->inverse() * point.position, &pixel));
      squares += (pixel - r.observations[o].pixel).squaredNorm();
    }
  }
  ASSERT_EQ(end, static_cast<int>(r.observations.size()));
  EXPECT_NEAR(std::sqrt(squares / end), r.rms_reprojection_px, 1e-6);
  EXPECT_LT(r.rms_reprojection_px, 1.0);
}

bool same_maps(const Reconstruction& a, const Reconstruction& b) {
  if (a.frames.size() != b.frames.size() || a.points.size() != b.points.size()) return false;
  for (size_t i = 0; i < a.frames.size(); ++i) {
    const PosedFrame &f = a.frames[i], &g = b.frames[i];
    if (f.segment != g.segment || f.reason != g.reason || f.covariance != g.covariance) return false;
    if (f.world_from_rig && (f.world_from_rig->translation != g.world_from_rig->translation ||
                             f.world_from_rig->rotation.coeffs() != g.world_from_rig->rotation.coeffs())) {
      return false;
    }
  }
  for (size_t i = 0; i < a.points.size(); ++i) {
    if (a.points[i].position != b.points[i].position) return false;
  }
  return a.rms_reprojection_px == b.rms_reprojection_px;
}

TEST(Odometry, PosesEveryFrameOfADrive) {
  const Footage input = one_scene(corridor());
  const Reconstruction r = run(input);
  expect_sound(r, input);
  expect_consistent_map(r);
  ASSERT_EQ(r.segments.size(), 1u);
  EXPECT_EQ(r.segments[0].first, 0);
  EXPECT_EQ(r.segments[0].last, 29);
  EXPECT_EQ(r.segments[0].reason, "end of input");
  for (const PosedFrame& f : r.frames) EXPECT_TRUE(f.world_from_rig) << f.reason;
  EXPECT_GT(r.keyframes.size(), 3u);
  EXPECT_GT(r.points.size(), 200u);
  expect_small_error(r, input, 0, 0);
}

// Few key frames are adjusted at once, so that poses are settled while the camera still moves.
TEST(Odometry, PosesEveryFrameWithASmallWindow) {
  const Footage input = one_scene(corridor());
  OdometryOptions options;
  options.free_cameras = 2;
  options.window = 4;
  options.global_until = 4;
  const Reconstruction r = run(input, options);
  expect_sound(r, input);
  expect_consistent_map(r);
  ASSERT_EQ(r.segments.size(), 1u);
  for (const PosedFrame& f : r.frames) EXPECT_TRUE(f.world_from_rig) << f.reason;
  expect_small_error(r, input, 0, 0, 1.0);
}

TEST(Odometry, FramesBeforeTheStartGetPosesAfterwards) {
  Footage input;
  input.add_black(3);
  for (int i = 0; i < 5; ++i) input.add(board(), 0, 0);  // stands
  input.add_all(board(), 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  EXPECT_EQ(r.segments[0].first, 3);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(r.frames[i].reason.empty()) << i;
  for (int i = 3; i < input.size(); ++i) EXPECT_TRUE(r.frames[i].world_from_rig) << r.frames[i].reason;
  expect_small_error(r, input, 0, 0);
}

TEST(Odometry, TwoRunsAreTheSameToTheLastBit) {
  Footage input = one_scene(board());
  input.add_black(2);
  input.add_all(corridor(), 1);
  EXPECT_TRUE(same_maps(run(input), run(input)));
  EXPECT_TRUE(same_maps(run(input, {}, true), run(input, {}, true)));
}

TEST(Odometry, AnotherSeedGivesNearlyTheSamePoses) {
  const Footage input = one_scene(corridor());
  Footage other = input;
  OdometryOptions options;
  options.seed = 4711;
  const Reconstruction a = run(input), b = run(input, options);
  for (int i = 0; i < input.size(); ++i) {
    ASSERT_TRUE(a.frames[i].world_from_rig);
    other.world_from_rig[i] = *a.frames[i].world_from_rig;
  }
  expect_small_error(b, other, 0, 0, 0.5);
}

TEST(Odometry, AFinalAdjustmentDoesNotHarm) {
  const Footage input = one_scene(corridor());
  const Reconstruction before = run(input), after = run(input, {}, true);
  expect_sound(after, input);
  expect_consistent_map(after);
  EXPECT_LT(after.rms_reprojection_px, 1.02 * before.rms_reprojection_px);
  expect_small_error(after, input, 0, 0);
}

TEST(Odometry, FindsTrackAgainAfterAGap) {
  Footage input = one_scene(board());
  input.add_black(4);
  for (int i = 23; i >= 6; --i) input.add(board(), i, 0);  // on from the same place, and back
  struct : TrackerObserver {
    std::vector<int> frames;
    void track_lost(const TrackLost& e) override { frames.push_back(e.frame); }
  } losses;
  const Reconstruction r = run(input, {}, false, &losses);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  for (int i = 0; i < input.size(); ++i) {
    EXPECT_EQ(r.frames[i].world_from_rig.has_value(), input.scene[i] >= 0) << i << r.frames[i].reason;
  }
  EXPECT_EQ(r.segments[0].last, input.size() - 1);
  EXPECT_EQ(r.segments[0].reason, "end of input");
  EXPECT_EQ(losses.frames, std::vector<int>{24});
  expect_small_error(r, input, 0, 0);
}

// What an image shows while the camera is shaken by some pixels.
GrayImage shaken(const GrayImage& image, int dx, int dy) {
  const int steps = 2 * std::max(std::abs(dx), std::abs(dy));
  GrayImage out(image.width(), image.height());
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      int sum = 0;
      for (int i = -steps; i <= steps; ++i) {
        const int u = std::clamp(x + (i * dx) / (2 * steps), 0, image.width() - 1);
        const int v = std::clamp(y + (i * dy) / (2 * steps), 0, image.height() - 1);
        sum += image.row(v)[u];
      }
      out.row(y)[x] = static_cast<uint8_t>(sum / (2 * steps + 1));
    }
  }
  return out;
}

TEST(Odometry, AShakeIsPosedAndHardlyAnyOfItBecomesAKeyFrame) {
  Footage input = one_scene(corridor());
  const std::set<int> shaking{12, 13, 14, 20, 21};
  for (const int i : shaking) {
    input.views[i] = testing_support::as_view(shaken(corridor().images[i], 16, i < 16 ? 12 : -5), i);
  }
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  for (int i = 0; i < input.size(); ++i) {
    EXPECT_TRUE(r.frames[i].world_from_rig.has_value()) << i << r.frames[i].reason;
  }
  EXPECT_LE(std::ranges::count_if(r.keyframes, [&](const KeyFrame& k) { return shaking.contains(k.frame); }),
            1);
  expect_small_error(r, input, 0, 0, 1);
}

// An image of which something near, on which there is nothing to see, hides a part from the left.
GrayImage partly_hidden(const GrayImage& image, double part) {
  GrayImage out(image.width(), image.height());
  for (int y = 0; y < out.height(); ++y) {
    std::copy_n(image.row(y), image.width(), out.row(y));
    std::fill_n(out.row(y), static_cast<int>(part * out.width()), uint8_t{60});
  }
  return out;
}

// Most of what the last key frame saw is hidden, and what is left is more than chance.
TEST(Odometry, FindsTrackAgainByAFewOfManyPoints) {
  constexpr int kGap = 4, kHidden = 5;
  constexpr double kPart = 0.66;
  Footage input = one_scene(corridor());
  const int before = input.size();
  input.add_black(kGap);
  for (int i = 0; i < kHidden; ++i) {
    const int index = before - 1 - i;
    input.add(corridor(), index, 0);
    input.views.back() = as_view(partly_hidden(corridor().images[index], kPart), input.size() - 1);
  }
  OdometryOptions options;
  options.min_matches = 200;
  const Reconstruction r = run(input, options);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  for (int i = before + kGap; i < input.size(); ++i) {
    EXPECT_TRUE(r.frames[i].world_from_rig.has_value()) << i << r.frames[i].reason;
  }
  expect_small_error(r, input, 0, 0, 1);
}

// However long nothing is seen, no other world is started meanwhile and every frame has its reason.
TEST(Odometry, FindsTrackAgainAfterALongWait) {
  constexpr int kWait = 400;
  Footage input = one_scene(board());
  input.add_black(kWait);
  for (int i = 23; i >= 12; --i) input.add(board(), i, 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  for (int i = 0; i < input.size(); ++i) {
    EXPECT_EQ(r.frames[i].world_from_rig.has_value(), input.scene[i] >= 0) << i << r.frames[i].reason;
    if (input.scene[i] < 0) {
      EXPECT_NE(r.frames[i].reason, "") << i;
    }
  }
  expect_small_error(r, input, 0, 0);
}

// The camera comes back to where it was long before.
TEST(Odometry, FindsTrackAgainAtAnOldPlace) {
  Footage input = one_scene(board());
  input.add_black(4);
  for (int i = 4; i <= 16; ++i) input.add(board(), i, 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  for (int i = 0; i < input.size(); ++i) {
    EXPECT_EQ(r.frames[i].world_from_rig.has_value(), input.scene[i] >= 0) << i << r.frames[i].reason;
  }
  expect_small_error(r, input, 0, 0);
}

// Never two worlds in one segment, with and without a gap between them.
class TwoScenesTest : public testing::TestWithParam<int> {};

TEST_P(TwoScenesTest, HaveASegmentEach) {
  Footage input = one_scene(board());
  input.add_black(GetParam());
  input.add_all(corridor(), 1);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  expect_consistent_map(r);
  ASSERT_EQ(r.segments.size(), 2u);
  EXPECT_NE(r.segments[0].reason, "end of input");
  EXPECT_EQ(r.segments[1].reason, "end of input");
  for (int i = 0; i < input.size(); ++i) EXPECT_EQ(r.frames[i].segment, input.scene[i]) << i;
  expect_small_error(r, input, 0, 0);
  expect_small_error(r, input, 1, 1);
}

INSTANTIATE_TEST_SUITE_P(Odometry, TwoScenesTest, testing::Values(0, 1, 6));

// Recognised or not: a board that looks alike from both sides must not enter a world the wrong way round.
TEST(Odometry, AnOldSceneThatComesBackFitsTheWorldThatItEnters) {
  Footage input = one_scene(board());
  input.add_all(corridor(), 1);
  for (int i = 23; i >= 0; --i) input.add(board(), i, 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  std::map<int, int> scene_of_segment;
  for (int i = 0; i < input.size(); ++i) {
    if (r.frames[i].segment < 0) continue;
    EXPECT_EQ(scene_of_segment.try_emplace(r.frames[i].segment, input.scene[i]).first->second, input.scene[i])
        << i;
  }
  for (const auto& [segment, scene] : scene_of_segment) expect_small_error(r, input, segment, scene);
}

// Two corridors of the same kind, of the same bricks and boards.
TEST(Odometry, ASceneOfTheSameKindIsNotTakenForTheOldOne) {
  Footage input = one_scene(corridor());
  input.add_all(synth_views("corridor", "drive", 30, 1), 1);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 2u);
  for (int i = 0; i < input.size(); ++i) EXPECT_EQ(r.frames[i].segment, input.scene[i]) << i;
  expect_small_error(r, input, 0, 0);
  expect_small_error(r, input, 1, 1);
}

// Angles between the orientations of frames and the true ones, from the first frame on, radians.
double largest_turn_error(const Reconstruction& r, const Footage& input, int first, int last) {
  double largest = 0;
  for (int i = first; i <= last; ++i) {
    const Eigen::Quaterniond found =
        r.frames[first].world_from_rig->rotation.conjugate() * r.frames[i].world_from_rig->rotation;
    const Eigen::Quaterniond truth =
        input.world_from_rig[first].rotation.conjugate() * input.world_from_rig[i].rotation;
    largest = std::max(largest, found.angularDistance(truth));
  }
  return largest;
}

TEST(Odometry, ACameraThatOnlyTurnsHasOrientations) {
  const Footage input = one_scene(synth_views("room", "rotate", 80));
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  EXPECT_TRUE(r.points.empty());
  for (int i = 0; i < input.size(); ++i) {
    ASSERT_TRUE(r.frames[i].world_from_rig) << i << ": " << r.frames[i].reason;
    EXPECT_TRUE(r.frames[i].place_held) << i;
    EXPECT_LT(r.frames[i].world_from_rig->translation.norm(), 1e-9) << i;
  }
  EXPECT_LT(largest_turn_error(r, input, 0, input.size() - 1), 0.005);
  OdometryOptions paper;
  paper.departures.turning = false;
  const Reconstruction none = run(input, paper);
  EXPECT_TRUE(none.segments.empty());
  for (const PosedFrame& f : none.frames) EXPECT_NE(f.reason.find("rotation"), std::string::npos) << f.reason;
}

// All round on the spot, and on along a corridor: the map does not reach back to most of the turn.
TEST(Odometry, ATurnBeforeAWayIsPosedByWhatItSees) {
  const SynthViews views = synth_views("corridor", "pan", 160);
  Footage input;
  constexpr int kStands = 46, kWalks = 74;  // frames of the film; of the input
  for (int i = kStands; i < views.size(); ++i) input.add(views, i, 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  const int world = r.frames[kWalks].segment;
  int held = 0;
  for (int i = 0; i < kWalks; ++i) {
    ASSERT_EQ(r.frames[i].segment, world) << i << ": " << r.frames[i].reason;
    held += r.frames[i].place_held;
  }
  EXPECT_GT(held, 30);
  EXPECT_LT(largest_turn_error(r, input, 0, kWalks), 0.01);
  expect_small_error(r, input, world, 0, 1);
}

// Along a corridor, all round on the spot, and on.
TEST(Odometry, ATurnOnTheSpotIsPosedByWhatItSees) {
  const Footage input = one_scene(synth_views("corridor", "pan", 160));
  const Reconstruction r = run(input);
  expect_sound(r, input);
  ASSERT_EQ(r.segments.size(), 1u);
  expect_small_error(r, input, 0, 0, 1);
  int held = 0, first = input.size(), last = 0;
  for (int i = 0; i < input.size(); ++i) {
    EXPECT_TRUE(r.frames[i].world_from_rig.has_value()) << i << r.frames[i].reason;
    if (!r.frames[i].place_held) continue;
    ++held;
    first = std::min(first, i);
    last = i;
    EXPECT_EQ(input.world_from_rig[i].translation, input.world_from_rig[80].translation) << i;
  }
  EXPECT_GT(held, 15);
  EXPECT_EQ(held, last - first + 1) << "in one run";
}

TEST(Odometry, AStandingCameraGetsAReasonAndNoPoses) {
  Footage input;
  for (int i = 0; i < 12; ++i) input.add(board(), 5, 0);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  EXPECT_TRUE(r.segments.empty());
  for (const PosedFrame& f : r.frames) EXPECT_NE(f.reason.find("no motion"), std::string::npos) << f.reason;
}

TEST(Odometry, TooFewFramesGetReasons) {
  for (int count = 0; count < 3; ++count) {
    Footage input;
    for (int i = 0; i < count; ++i) input.add(board(), 6 * i, 0);
    for (const bool final_global : {false, true}) {
      const Reconstruction r = run(input, {}, final_global);
      expect_sound(r, input);
      EXPECT_TRUE(r.segments.empty());
      EXPECT_TRUE(r.points.empty());
      EXPECT_EQ(r.rms_reprojection_px, 0);
      for (const PosedFrame& f : r.frames) {
        EXPECT_NE(f.reason.find(std::to_string(count) + " frames are too few"), std::string::npos)
            << f.reason;
      }
    }
  }
}

TEST(Odometry, OnlyBlackFramesGetReasons) {
  Footage input;
  input.add_black(6);
  const Reconstruction r = run(input);
  expect_sound(r, input);
  EXPECT_TRUE(r.segments.empty());
}

// Steps so small that not every other frame is a key frame.
TEST(Odometry, CornersAreDetectedWhereTheyAreNeededAndAreTheSame) {
  const Footage input = one_scene(synth_views("board", "orbit", 96));
  const Reconstruction at_once = run(input);
  const LateRun late = run_without_corners(input);
  ASSERT_EQ(at_once.starts.size(), 1u);
  ASSERT_EQ(late.reconstruction.frames.size(), at_once.frames.size());
  for (int i = 0; i < input.size(); ++i) {
    ASSERT_TRUE(late.reconstruction.frames[i].world_from_rig) << i;
    EXPECT_EQ(late.reconstruction.frames[i].world_from_rig->translation,
              at_once.frames[i].world_from_rig->translation)
        << i;
  }
  const int started = at_once.starts[0].frames[2];
  const auto tracked = std::span(late.detected).subspan(started + 1);
  const auto detected = std::ranges::count(tracked, 1);
  // Those of the start had theirs before; the first frame after it has no motion to be predicted from.
  EXPECT_LE(detected, std::ssize(at_once.keyframes) - 3 + 1);
  EXPECT_LT(2 * detected, std::ssize(tracked));
}

// The orbit goes on from where eight frames are missing.
TEST(Odometry, AFrameFarFromItsPredictionIsFoundByItsCorners) {
  const SynthViews views = synth_views("board", "orbit", 48);
  Footage input;
  constexpr int kJump = 24, kMissing = 8;
  for (int i = 0; i < views.size(); ++i) {
    if (i < kJump || i >= kJump + kMissing) input.add(views, i, 0);
  }
  const LateRun late = run_without_corners(input);
  EXPECT_TRUE(late.detected[kJump]);
  ASSERT_EQ(late.reconstruction.segments.size(), 1u);
  EXPECT_TRUE(late.reconstruction.frames[kJump].world_from_rig);
  expect_small_error(late.reconstruction, input, 0, 0);
}

// Nine in ten ellipsoids hold the error that is left when a stretch of frames is aligned with the truth,
// which the noise of the frames' own pixels is the smaller part of.
TEST(Odometry, CovariancesHoldTheErrorsOfShortStretches) {
  constexpr int kFrames = 80;
  constexpr std::array kLengths = {40};
  int frames = 0;
  double held = 0, error2 = 0, orientations = 0;
  for (const uint64_t seed : {1, 2, 3, 4}) {
    const Footage input = one_scene(synth_views(seed % 2 ? "room" : "corridor", "walk", kFrames, seed));
    const Reconstruction r = run(input);
    Trajectory estimate, truth;
    std::vector<Matrix6d> covariances;
    for (int i = 0; i < kFrames; ++i) {
      if (r.frames[i].segment != 0) continue;
      for (Trajectory* t : {&estimate, &truth}) t->timestamps.push_back(i);
      estimate.world_from_cam.push_back(*r.frames[i].world_from_rig);
      truth.world_from_cam.push_back(input.world_from_rig[i]);
      covariances.push_back(r.frames[i].covariance);
    }
    const auto windows = window_consistency(estimate, covariances, truth, {}, kLengths);
    ASSERT_TRUE(windows) << windows.error().message;
    const WindowConsistency& w = windows->front();
    frames += w.frames;
    held += w.frames * w.position.held;
    orientations += w.frames * w.orientation.held;
    error2 += w.frames * w.position.normalised_error2;
  }
  ASSERT_GE(frames, 240);
  EXPECT_GT(held / frames, 0.8);
  EXPECT_LT(held / frames, 0.99);
  EXPECT_GT(error2 / frames, 0.4);
  EXPECT_LT(error2 / frames, 1.6);
  EXPECT_GT(orientations / frames, 0.7);
}

// A picture behind a wall that covers `part` of its width and has gone by so many pixels, painted with
// another picture upside down.
GrayImage behind_wall(const GrayImage& image, const GrayImage& paint, double part, int shift) {
  GrayImage out(image.width(), image.height());
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      const bool wall = x >= (1 - part) * image.width();
      out.row(y)[x] = wall ? paint.row(image.height() - 1 - y)[(x + shift) % image.width()] : image.row(y)[x];
    }
  }
  return out;
}

// What moves by itself is told, with its part of the image; a world that stands still is not.
TEST(Odometry, WhatMovesByItselfIsTold) {
  const SynthViews& views = corridor();
  const auto seen = [&](double part) {
    const ViewMaker maker({{0, {}, {.max_features = 1500}}});
    Odometry odometry(Rig{{small_camera()}}, {}, {}, &maker);
    for (int i = 0; i < views.size(); ++i) {
      GrayImage image = behind_wall(views.images[i], views.images[0], part, 3 * i);
      odometry.process(without_corners(*as_view(std::move(image), i)));
    }
    return odometry.other_motion();
  };
  EXPECT_TRUE(seen(0).empty());
  const std::vector<OtherMotion> moving = seen(0.35);
  ASSERT_FALSE(moving.empty());
  EXPECT_NEAR(moving[0].part, 0.35, 0.15);
}

// A view that repeats the one of another frame.
ViewPtr copy_of(int original, int frame, double timestamp) {
  auto view = std::make_shared<View>();
  view->frame = frame;
  view->timestamp = timestamp;
  view->same_as = original;
  return view;
}

// The views of a film, each shown several times; with `copies` false the copies are left out.
std::vector<ViewPtr> shown_again(const SynthViews& film, const std::vector<int>& times, bool copies) {
  std::vector<ViewPtr> views;
  double now = 0;
  for (int i = 0; i < film.size(); ++i) {
    const int original = static_cast<int>(views.size());
    const auto view = std::const_pointer_cast<View>(film.view(i, original));
    view->timestamp = now;
    view->repeats = original - i;
    views.push_back(view);
    for (int k = 1; k < times[i]; ++k) {
      if (copies) views.push_back(copy_of(original, original + k, now + 0.1 * k));
    }
    now += 0.1 * times[i];
  }
  return views;
}

// What of a frame's pose is told again by events.
class PosesTold : public TrackerObserver {
 public:
  void frame_posed(const FramePosed& e) override { ++times[e.frame]; }
  std::map<int, int> times;
};

// Rolling shutters ask for velocities, and what calibrations are refined with for the time between key
// frames.
TEST(Odometry, AFilmWithCopiesIsTheFilmWithoutThem) {
  const SynthViews film = synth_views("corridor", "drive", 60, 0, 0.02);
  std::vector<int> times;
  for (int i = 0; i < film.size(); ++i) times.push_back(i < 30 ? 3 : 2 + i % 2);
  Camera camera = small_camera();
  camera.shutter.readout = 0.02;
  OdometryOptions options;
  options.calibration_prior = {.focal = 0.02, .centre = 0.01, .rim = 0.01};
  Odometry once(Rig{{camera}}, options);
  for (const ViewPtr& view : shown_again(film, times, false)) once.process(view);
  PosesTold told;
  Odometry again(Rig{{camera}}, options, &told);
  for (const ViewPtr& view : shown_again(film, times, true)) again.process(view);
  EXPECT_EQ(again.posed(), again.frames());
  const Reconstruction a = once.finish(true), b = again.finish(true);
  ASSERT_GT(a.keyframes.size(), 20u);
  EXPECT_EQ(a.keyframes.size(), b.keyframes.size());
  EXPECT_EQ(a.observations.size(), b.observations.size());
  ASSERT_EQ(b.segments.size(), 1u);
  EXPECT_EQ(b.segments[0].last, std::ssize(b.frames) - 1);
  size_t frame = 0;
  for (int i = 0; i < film.size(); ++i) {
    ASSERT_TRUE(a.frames[i].world_from_rig) << i;
    for (int k = 0; k < times[i]; ++k, ++frame) {
      ASSERT_TRUE(b.frames[frame].world_from_rig) << frame;
      EXPECT_EQ(b.frames[frame].world_from_rig->translation, a.frames[i].world_from_rig->translation) << i;
      EXPECT_EQ(b.frames[frame].covariance, a.frames[i].covariance) << i;
      EXPECT_EQ(told.times[static_cast<int>(frame)], 1) << frame;
    }
  }
  EXPECT_EQ(frame, b.frames.size());
}

}  // namespace
}  // namespace raysfm
