#include "raysfm/merging/join_pieces.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "raysfm/odometry/odometry.h"
#include "raysfm/scene/worlds.h"
#include "support/synth_maps.h"

namespace raysfm {
namespace {

using testing_support::saved_maps;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

constexpr int kFrames = 120;

// Round a room.
const SynthViews& way() {
  static const SynthViews views = synth_views("room", "loop", 200);
  return views;
}

// What a run over frames [first, end) gives, and the map that it leaves; timestamps are those of the whole.
VideoPiece piece_of(int first, int end, const Camera& camera = small_camera(),
                    LensRefinement how = LensRefinement::kAuto) {
  Odometry odometry(Rig{{camera}}, {.refine_lens = how});
  for (int i = first; i < end; ++i) odometry.process(way().view(i, i - first));
  std::vector<Map> maps;
  VideoPiece piece{"from " + std::to_string(first), odometry.finish(false, &maps), {}};
  for (int i = first; i < end; ++i) {
    PosedFrame& frame = piece.result.frames[i - first];
    frame.timestamp = i;
    frame.image_name = fmt::format("frame-{:06}", i - first);
  }
  piece.map = saved_maps(std::move(maps), first);
  piece.map.rig = piece.result.rig;
  return piece;
}

const std::vector<VideoPiece>& pieces() {
  static const std::vector<VideoPiece> made = {piece_of(0, 60), piece_of(30, kFrames)};
  return made;
}

double percent_of_path(const Reconstruction& r) {
  Trajectory estimate;
  for (const PosedFrame& frame : r.frames) {
    if (!frame.world_from_rig) continue;
    estimate.timestamps.push_back(frame.timestamp);
    estimate.world_from_cam.push_back(*frame.world_from_rig);
  }
  return testing_support::percent_of_path(estimate, way());
}

TEST(JoinPieces, EveryFrameIsThereOnceInOneWorld) {
  const Result<JoinedPieces> joined = join_pieces({pieces()[1], pieces()[0]}, 0);  // in any order
  ASSERT_TRUE(joined) << joined.error().message;
  const Reconstruction& r = joined->result;
  ASSERT_EQ(r.frames.size(), static_cast<size_t>(kFrames));
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_EQ(r.frames[i].timestamp, i);
    EXPECT_EQ(r.frames[i].image_name, fmt::format("frame-{:06}", i));
  }
  ASSERT_EQ(r.segments.size(), 1u);
  EXPECT_EQ(r.segments[0].last, kFrames - 1);
  EXPECT_GT(posed_count(r), kFrames - 10);
  EXPECT_LT(percent_of_path(r), 0.2);
  EXPECT_LT(r.rms_reprojection_px, 1);
  const auto later = [](const KeyFrame& a, const KeyFrame& b) { return a.frame >= b.frame; };
  EXPECT_EQ(std::ranges::adjacent_find(r.keyframes, later), r.keyframes.end());
  const size_t apart = pieces()[0].result.keyframes.size() + pieces()[1].result.keyframes.size();
  EXPECT_GT(r.keyframes.size(), apart / 2);
  EXPECT_LE(r.keyframes.size(), apart);
  for (const KeyFrame& k : r.keyframes) EXPECT_TRUE(r.frames[k.frame].world_from_rig) << k.frame;
  EXPECT_TRUE(check_saved_map(joined->map));
}

// A result that was read back has the names of its key frames alone; those of the joined one may come from
// the piece of which the frame does not.
TEST(JoinPieces, EveryKeyFrameHasAName) {
  std::vector<VideoPiece> read_back = pieces();
  for (VideoPiece& piece : read_back) {
    std::vector<uint8_t> is_keyframe(piece.result.frames.size(), 0);
    for (const KeyFrame& k : piece.result.keyframes) is_keyframe[k.frame] = 1;
    for (size_t f = 0; f < is_keyframe.size(); ++f) {
      if (!is_keyframe[f]) piece.result.frames[f].image_name.clear();
    }
  }
  const Result<JoinedPieces> joined = join_pieces(read_back, 0);
  ASSERT_TRUE(joined) << joined.error().message;
  for (const KeyFrame& k : joined->result.keyframes)
    EXPECT_EQ(joined->result.frames[k.frame].image_name, fmt::format("frame-{:06}", k.frame));
}

// A piece in another unit, turned and shifted, comes out the same, its covariances too.
TEST(JoinPieces, TheFrameAndUnitOfAPieceDoNotMatter) {
  const Result<JoinedPieces> joined = join_pieces(pieces(), 0);
  std::vector<VideoPiece> other = pieces();
  const double unit = 3;
  const Rigid3 there{Eigen::Quaterniond(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitY())), {4, 5, 6}};
  const auto moved = [&](const Rigid3& world_from_rig) {
    Rigid3 scaled = world_from_rig;
    scaled.translation *= unit;
    return there * scaled;
  };
  Matrix6d change = Matrix6d::Zero();
  change.topLeftCorner<3, 3>() = unit * there.rotation.toRotationMatrix();
  change.bottomRightCorner<3, 3>() = there.rotation.toRotationMatrix();
  for (PosedFrame& frame : other[1].result.frames) {
    if (!frame.world_from_rig) continue;
    frame.world_from_rig = moved(*frame.world_from_rig);
    frame.covariance = (change * frame.covariance * change.transpose()).eval();
  }
  Map& map = other[1].map.worlds[0].map;
  for (MapKeyFrame& k : map.keyframes) k.rig_from_world = moved(k.rig_from_world.inverse()).inverse();
  for (Track& track : map.tracks) track.position = there * Eigen::Vector3d(unit * track.position);
  const Result<JoinedPieces> again = join_pieces(other, 0);
  ASSERT_TRUE(joined && again);
  ASSERT_EQ(again->result.segments.size(), 1u);
  for (int i = 0; i < kFrames; ++i) {
    const PosedFrame &a = joined->result.frames[i], &b = again->result.frames[i];
    ASSERT_EQ(a.world_from_rig.has_value(), b.world_from_rig.has_value());
    if (!a.world_from_rig) continue;
    EXPECT_LT((a.world_from_rig->translation - b.world_from_rig->translation).norm(), 2e-3) << i;
    EXPECT_LT((a.covariance - b.covariance).norm(), 0.02 * a.covariance.norm()) << i;
  }
}

// Nothing of theirs is described, so that no place is recognised: common frames are enough.
std::vector<VideoPiece> without_places(std::vector<VideoPiece> pieces) {
  for (VideoPiece& piece : pieces) {
    for (MapKeyFrame& k : piece.map.worlds[0].map.keyframes) k.described.clear(), k.descriptors.clear();
  }
  return pieces;
}

TEST(JoinPieces, CommonFramesAreEnough) {
  const Result<JoinedPieces> joined = join_pieces(without_places(pieces()), 0);
  ASSERT_TRUE(joined) << joined.error().message;
  ASSERT_EQ(joined->result.segments.size(), 1u);
  EXPECT_LT(percent_of_path(joined->result), 0.2);
  EXPECT_GT(joined->worlds[1].points, 50);
  // Ten frames, and a third piece that goes on from the second, in its own unit.
  const Result<JoinedPieces> three =
      join_pieces(without_places({piece_of(0, 50), piece_of(40, 90), piece_of(80, kFrames)}), 0);
  ASSERT_TRUE(three) << three.error().message;
  ASSERT_EQ(three->result.segments.size(), 1u);
  EXPECT_LT(percent_of_path(three->result), 0.3);
}

Camera with_focal(double factor) {
  Camera camera = small_camera();
  auto p = std::get<Radtan>(camera.model).parameters();
  p[0] *= factor;
  p[1] *= factor;
  camera.model = Radtan::from_parameters(p);
  return camera;
}

double focal_length(const Rig& rig) {
  return std::get<Radtan>(rig.cameras[0].model).parameters()[0];
}

// The first has another lens, and nobody is to refine it.
TEST(JoinPieces, TheMostTypicalCamerasAreTaken) {
  constexpr LensRefinement kOff = LensRefinement::kOff;
  const Result<JoinedPieces> joined =
      join_pieces({piece_of(0, 50, with_focal(1.1), kOff), piece_of(30, 90, small_camera(), kOff),
                   piece_of(70, kFrames, small_camera(), kOff)},
                  0);
  ASSERT_TRUE(joined) << joined.error().message;
  EXPECT_EQ(joined->result.segments.size(), 1u);
  EXPECT_EQ(focal_length(joined->result.rig), focal_length({{small_camera()}}));
  EXPECT_TRUE(joined->result.calibration.empty());
  EXPECT_LT(percent_of_path(joined->result), 0.3);
}

// A lens that is given 2 % too long, and of which no piece saw enough to change it.
TEST(JoinPieces, CamerasAreRefinedOnWhatAllPiecesSaw) {
  std::vector<VideoPiece> four;
  for (const int first : {0, 26, 54, 82}) {
    VideoPiece& piece = four.emplace_back(
        piece_of(first, std::min(kFrames, first + 38), with_focal(1.02), LensRefinement::kOff));
    const double given = focal_length(piece.map.rig);
    piece.result.calibration = {{0, "fx", given, given}, {0, "readout_down", 0, 0.01}};
  }
  const double exact = focal_length({{small_camera()}});
  const Result<JoinedPieces> joined = join_pieces(four, 0);
  ASSERT_TRUE(joined) << joined.error().message;
  ASSERT_EQ(joined->result.segments.size(), 1u);
  EXPECT_NEAR(focal_length(joined->result.rig), exact, 0.004 * exact);
  ASSERT_EQ(joined->result.calibration.size(), 2u);
  EXPECT_EQ(joined->result.calibration[0].refined, focal_length(joined->result.rig));
  EXPECT_NEAR(joined->result.calibration[0].given, focal_length({{with_focal(1.02)}}), 1e-9 * exact);
  EXPECT_EQ(joined->result.calibration[1].refined, 0.01);
  // Nobody was to refine them.
  for (VideoPiece& piece : four) piece.result.calibration.clear();
  const Result<JoinedPieces> kept = join_pieces(four, 0);
  ASSERT_TRUE(kept);
  EXPECT_EQ(focal_length(kept->result.rig), focal_length({{with_focal(1.02)}}));
}

TEST(JoinPieces, WithoutACommonFrameOrPlaceTheyStayApart) {
  const std::vector<VideoPiece> apart = without_places({piece_of(0, 50), piece_of(60, kFrames)});
  const Result<JoinedPieces> joined = join_pieces(apart, 0);
  ASSERT_TRUE(joined) << joined.error().message;
  EXPECT_EQ(joined->result.frames.size(), kFrames - 10u);
  EXPECT_EQ(joined->result.segments.size(), 2u);
  for (const Segment& segment : joined->result.segments) EXPECT_GT(segment.last, segment.first);
  EXPECT_EQ(joined->worlds[1].points, 0);
}

TEST(JoinPieces, RefusesWhatCannotBeJoined) {
  std::vector<VideoPiece> wrong = pieces();
  wrong[1].map.worlds[0].sources[2].timestamp += 0.5;
  EXPECT_NE(join_pieces(wrong, 0).error().message.find("from 30: the map is of another run"),
            std::string::npos);
  wrong = pieces();
  wrong[0].result.origin = Origin::kSolve;
  EXPECT_NE(join_pieces(wrong, 0).error().message.find("from 0: "), std::string::npos);
  for (VideoPiece& piece : wrong) {
    piece.result.origin = Origin::kTrack;
    for (PosedFrame& frame : piece.result.frames) frame.world_from_rig.reset();
  }
  EXPECT_EQ(join_pieces(wrong, 0).error().kind, ErrorKind::kNoReconstruction);
}

}  // namespace
}  // namespace raysfm
