#include "raysfm/photos/track_bridges.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr int kImages = 24, kSeen = 500;  // of each stretch; points that both see

Descriptor random_descriptor(Rng* rng) {
  Descriptor code;
  for (uint64_t& bits : code.bits) bits = rng->next();
  return code;
}

// A camera goes along a wall of points twice, each time in a stretch of tracks of its own: point i of the
// second is point i - kSeen of the first, and looks like it.
struct TwoStretches {
  std::vector<Rigid3> cam_from_world;
  PointTracks tracks;
  std::vector<DescribedImage> described;

  // `related`: else the second stretch sees a wall of other points, which look like those of the first in
  // another order.
  explicit TwoStretches(bool related) {
    Rng rng(4);
    std::vector<Eigen::Vector3d> points;
    std::vector<Descriptor> looks;
    for (int i = 0; i < kSeen; ++i) {
      points.emplace_back(rng.uniform(-6, 10), rng.uniform(-4, 4), rng.uniform(6, 12));
      looks.push_back(random_descriptor(&rng));
    }
    tracks.image_count = 2 * kImages, tracks.point_count = 2 * kSeen, tracks.image_size = {640, 480};
    for (int j = 0; j < 2 * kImages; ++j) {
      const bool second = j >= kImages;
      const double s = static_cast<double>(j % kImages) / kImages + (second ? 0.03 : 0);
      const Eigen::Quaterniond turn =
          exp_so3({0.15 * std::sin(9 * s), 0.2 * std::sin(7 * s), (second ? 0.1 : 0.2) * std::sin(11 * s)});
      const Eigen::Vector3d centre(4 * s, 0.8 * std::sin(8 * s), (second ? 1.0 : 1.5) * std::sin(10 * s));
      cam_from_world.push_back({turn, -(turn * centre)});
      DescribedImage& image = described.emplace_back();
      image.image = j;
      for (int i = 0; i < kSeen; ++i) {
        const Eigen::Vector3d x =
            cam_from_world.back() * points[second && !related ? (i * 7 + 3) % kSeen : i];
        const Eigen::Vector2d p = 500 * x.hnormalized() + Eigen::Vector2d(319.5, 239.5) +
                                  0.2 * Eigen::Vector2d(rng.normal(), rng.normal());
        if (p.x() < 0 || p.y() < 0 || p.x() > 639 || p.y() > 479) continue;
        const int point = second ? kSeen + i : i;
        tracks.add(j, point, p);
        image.points.push_back(point);
        Descriptor seen = looks[i];
        for (int flip = 0; flip < 20; ++flip) seen.bits[rng.index(4)] ^= uint64_t{1} << rng.index(64);
        image.descriptors.push_back(seen);
      }
    }
  }

  std::vector<TrackBridge> bridges(int workers = 0) const {
    ThreadPool pool(workers);
    return find_bridges(tracks, described, {}, 3, 0, nullptr, &pool);
  }
};

TEST(TrackBridges, JoinTwoStretchesToOneWorldOfOneScale) {
  const TwoStretches video(true);
  const std::vector<TrackBridge> bridges = video.bridges();
  ASSERT_GT(bridges.size(), 10U);
  int right = 0, all = 0;
  for (const TrackBridge& bridge : bridges) {
    EXPECT_LT(bridge.images[0], kImages);
    EXPECT_GE(bridge.images[1], kImages);
    for (const auto& [a, b] : bridge.same) right += b - a == kSeen, ++all;
  }
  EXPECT_GT(right, 0.99 * all);

  const std::vector<uint8_t> keyframe(2 * kImages, 1);
  const SolveOptions options{.lens = LensChange::kFixed};
  const auto apart = reconstruct_video(video.tracks, keyframe, options);
  ASSERT_TRUE(apart.ok()) << apart.error().message;
  EXPECT_EQ(std::ranges::count(apart->image_posed, 1), kImages);

  PointTracks joined = video.tracks;
  EXPECT_EQ(join_points(bridges, &joined).size(), size_t{2 * kSeen});
  const auto whole = reconstruct_video(joined, keyframe, options);
  ASSERT_TRUE(whole.ok()) << whole.error().message;
  ASSERT_EQ(std::ranges::count(whole->image_posed, 1), 2 * kImages);
  // The similarity that the first stretch tells holds for the second.
  Eigen::Matrix<double, 3, Eigen::Dynamic> found(3, 2 * kImages), truth(3, 2 * kImages);
  for (int j = 0; j < 2 * kImages; ++j) {
    found.col(j) = whole->scene.cam_from_world[j].inverse().translation;
    truth.col(j) = video.cam_from_world[j].inverse().translation;
  }
  const Eigen::Matrix4d similarity = Eigen::umeyama(found.leftCols(kImages), truth.leftCols(kImages));
  for (int j = kImages; j < 2 * kImages; ++j) {
    const Eigen::Vector3d centre = (similarity * found.col(j).homogeneous()).head<3>();
    EXPECT_LT((centre - truth.col(j)).norm(), 0.02) << j;
  }
}

// Points that look alike, by the hundred, but lie elsewhere.
TEST(TrackBridges, UnrelatedStretchesStayApart) {
  EXPECT_TRUE(TwoStretches(false).bridges().empty());
}

TEST(TrackBridges, AreTheSameOnAnyNumberOfThreads) {
  const TwoStretches video(true);
  const std::vector<TrackBridge> one = video.bridges(), three = video.bridges(2);
  ASSERT_EQ(one.size(), three.size());
  for (size_t i = 0; i < one.size(); ++i) EXPECT_EQ(one[i].same, three[i].same);
}

TEST(TrackBridges, ImagesThatHavePosesNeedNone) {
  const TwoStretches video(true);
  ThreadPool pool(0);
  const std::vector<uint8_t> posed(2 * kImages, 1);
  EXPECT_TRUE(find_bridges(video.tracks, video.described, posed, 3, 0, nullptr, &pool).empty());
}

// Two tracks that one image sees are two points, whatever a bridge says.
TEST(TrackBridges, NoPointIsSeenTwiceInAnImage) {
  PointTracks tracks;
  tracks.image_count = 2, tracks.point_count = 3, tracks.image_size = {100, 100};
  tracks.add(0, 0, {1, 1}), tracks.add(0, 1, {5, 5}), tracks.add(1, 2, {2, 2});
  const TrackBridge bridge{{0, 1}, {{0, 2}, {1, 2}}, -20};
  EXPECT_EQ(join_points({&bridge, 1}, &tracks), (std::vector<int>{0, 1, 0}));
  EXPECT_EQ(tracks.point_count, 2);
  EXPECT_EQ(tracks.point, (std::vector<int>{0, 1, 0}));
}

}  // namespace
}  // namespace raysfm
