#include "raysfm/synth/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "raysfm/geometry/rotation.h"
#include "raysfm/synth/zoom.h"

namespace raysfm::synth {
namespace {

using Eigen::Vector3d;

Motion motion_in(const World& world, const char* name, double duration, double length = 0) {
  Result<Motion> motion =
      make_motion(world.stage, world.habit, {name, duration, length > 0 ? length : world.length, 3});
  EXPECT_TRUE(motion);
  return *std::move(motion);
}

const World& world_of(const char* name) {
  static std::map<std::string, World> worlds;  // building them takes longer than testing them
  const auto [entry, is_new] = worlds.try_emplace(name);
  if (is_new) {
    ThreadPool pool(1);
    Result<World> world = make_world(name, {}, pool);
    EXPECT_TRUE(world);
    entry->second = *std::move(world);
  }
  return entry->second;
}

// Largest change of acceleration (metres and radians, per second squared) between instants `h` apart.
double largest_jump(const Motion& motion, double duration, double h) {
  Vector3d last_linear = Vector3d::Zero(), last_angular = last_linear;
  double largest = 0;
  bool first = true;
  for (double t = 1.0; t < duration - 1.0; t += h) {
    const Rigid3 a = motion(t - h), b = motion(t), c = motion(t + h);
    const Vector3d linear = (a.translation - 2 * b.translation + c.translation) / (h * h);
    const Vector3d angular =
        (log_so3(c.rotation * b.rotation.conjugate()) - log_so3(b.rotation * a.rotation.conjugate())) /
        (h * h);
    if (!first) largest = std::max({largest, (linear - last_linear).norm(), (angular - last_angular).norm()});
    first = false;
    last_linear = linear;
    last_angular = angular;
  }
  return largest;
}

class Motions : public testing::TestWithParam<std::tuple<const char*, const char*>> {};

TEST_P(Motions, AccelerationIsContinuous) {
  const auto& [world_name, name] = GetParam();
  const World& world = world_of(world_name);
  const double duration = world.habit.frames / world.habit.fps;
  const Motion motion = motion_in(world, name, duration);
  // Where the acceleration is continuous, its change over h goes to zero with h; at a step it stays.
  const double coarse = largest_jump(motion, duration, 8e-3), fine = largest_jump(motion, duration, 2e-3);
  EXPECT_LT(fine, 0.35 * coarse);
}

INSTANTIATE_TEST_SUITE_P(Everywhere, Motions,
                         testing::Combine(testing::Values("street", "room", "corridor", "board"),
                                          testing::Values("drive", "walk", "look", "pan", "loop", "handheld",
                                                          "orbit", "rotate")));

TEST(Motion, PanTurnsOnceOnTheSpot) {
  constexpr double kDuration = 20;
  const Motion motion = motion_in(world_of("corridor"), "pan", kDuration, 6);
  const Rigid3 before = motion(0.25 * kDuration), after = motion(0.75 * kDuration);
  EXPECT_LT((before.translation - motion(0).translation).norm(), 3.01);
  EXPECT_GT((before.translation - motion(0).translation).norm(), 2.8);
  EXPECT_LT(before.rotation.angularDistance(after.rotation), 0.06);
  double turned = 0;
  for (int i = 0; i < 100; ++i) {
    const Rigid3 a = motion((0.25 + 0.005 * i) * kDuration), b = motion((0.255 + 0.005 * i) * kDuration);
    EXPECT_EQ(a.translation, before.translation);
    turned += a.rotation.angularDistance(b.rotation);
  }
  EXPECT_NEAR(turned, 2 * std::numbers::pi, 0.2);
  EXPECT_GT((motion(kDuration).translation - after.translation).norm(), 2.8);
}

TEST(Motion, WalkCoversItsLengthAndLooksAhead) {
  struct Case {
    const char* world;
    double length, duration;
  };
  for (const auto& [name, length, duration] :
       {Case{"room", 15, 20.4}, Case{"corridor", 20, 20}, Case{"street", 40, 60}, Case{"town", 40, 60}}) {
    const Motion motion = motion_in(world_of(name), "walk", duration, length);
    const double h = 1;  // a second or so averages over the steps
    double way = 0, sideways = 0;
    for (double t = 0; t + h <= duration; t += h) {
      const Vector3d step = motion(t + h).translation - motion(t).translation;
      way += step.norm();
      const Vector3d ahead = motion(t + 0.5 * h).rotation * Vector3d::UnitZ();
      sideways = std::max(sideways, std::acos(ahead.dot(step.normalized())));
    }
    EXPECT_NEAR(way, length, 0.12 * length) << name;
    EXPECT_LT(sideways, 1.4) << name << ": radians off the way";
  }
}

TEST(Motion, StraightIsWithoutAnyRotationOrAcceleration) {
  for (const char* name : {"street", "town", "room", "corridor", "board"}) {
    const World& world = world_of(name);
    const double length = world.stage.straight_length;
    const Motion motion = motion_in(world, "straight", 10, length);
    const Vector3d velocity = (motion(10).translation - motion(0).translation) / 10;
    EXPECT_NEAR(velocity.norm(), length / 10, 1e-9);
    for (const double t : {1.0, 3.7, 9.2}) {
      EXPECT_EQ(motion(t).rotation.coeffs(), motion(0).rotation.coeffs());
      EXPECT_LT((motion(t).translation - motion(0).translation - t * velocity).norm(), 1e-9);
    }
    EXPECT_FALSE(make_motion(world.stage, world.habit, {"straight", 10, 1.01 * length, 0})) << name;
  }
}

TEST(Motion, LookTurnsFarToAllSides) {
  const Motion motion = motion_in(world_of("room"), "look", 20, 14);
  double most = 0;
  for (double t = 0; t < 20; t += 0.5) {
    most = std::max(most, rotation_angle(motion(t).rotation * motion(0).rotation.conjugate()));
  }
  EXPECT_GT(most, 1.0);
}

// A wall that a camera walks through would be seen from behind.
TEST(Motion, WalksKeepAwayFromWalls) {
  for (const char* name : {"room", "corridor"}) {
    const World& world = world_of(name);
    const double length = name[0] == 'r' ? 15 : 20;
    const Motion motion = motion_in(world, "walk", 20, length);
    for (double t = 0; t < 20; t += 0.25) {
      const Vector3d at = motion(t).translation;
      if (name[0] == 'r') {
        EXPECT_LT(std::abs(at.x()), 2.6) << t;
        EXPECT_LT(std::abs(at.z()), 2.3) << t;
      } else {
        EXPECT_LT(std::abs(at.x()), 13.3) << t;
      }
      EXPECT_NEAR(at.y(), world.stage.eye.y(), 0.2);
    }
  }
}

TEST(Motion, RotateKeepsTheCentreExactly) {
  for (const char* name : {"street", "room", "corridor", "board", "town"}) {
    const World& world = world_of(name);
    const Motion motion = motion_in(world, "rotate", 20);
    double turned = 0;
    for (double t = 0; t < 20; t += 0.1) {
      EXPECT_EQ(motion(t).translation, motion(0).translation);
      turned += rotation_angle(motion(t + 0.1).rotation * motion(t).rotation.conjugate());
    }
    EXPECT_GT(turned, 6.0) << "a full turn";
  }
}

TEST(Motion, DriveCoversItsLength) {
  const World& street = world_of("street");
  const Motion motion = motion_in(street, "drive", 445 / 7.5, 70);
  double way = 0;
  for (double t = 0; t < 445 / 7.5 - 0.05; t += 0.1) {
    way += (motion(t + 0.1).translation - motion(t).translation).norm();
  }
  EXPECT_NEAR(way, 70, 1.0);
  EXPECT_NEAR(motion(445 / 7.5).translation.z(), 70, 0.5);
}

TEST(Motion, TownGoesOutAndComesBack) {
  const World& town = world_of("town");
  const double duration = town.habit.frames / town.habit.fps;
  const Motion motion = motion_in(town, "drive", duration);
  double farthest = 0, way = 0;
  for (double t = 0; t < duration; t += 0.2) {
    farthest = std::max(farthest, motion(t).translation.z());
    way += (motion(t + 0.2).translation - motion(t).translation).norm();
  }
  EXPECT_GT(farthest, 200);
  EXPECT_NEAR((motion(30).translation - motion(29).translation).norm(), 2.5, 0.1) << "metres per second";
  EXPECT_NEAR(way, 500, 10);
  EXPECT_LT(std::abs(motion(duration).translation.z()), 12);
  const Vector3d ahead = motion(duration).rotation * Vector3d::UnitZ();
  EXPECT_LT(ahead.z(), -0.99) << "looks back where it came from";
}

TEST(Motion, LoopCloses) {
  for (const char* name : {"street", "room", "corridor", "town", "terrace"}) {
    const Motion motion = motion_in(world_of(name), "loop", 30);
    EXPECT_LT((motion(30).translation - motion(0).translation).norm(), 0.1) << name;
    EXPECT_GT((motion(15).translation - motion(0).translation).norm(), 1.0) << name;
  }
}

TEST(Motion, LoopGoesRoundAsOftenAsTold) {
  for (const char* name : {"room", "town", "terrace"}) {
    const World& world = world_of(name);
    const double duration = 200;
    const auto loop = [&](double rounds) {
      return *make_motion(world.stage, world.habit, {"loop", duration, 1, 3, 1, rounds});
    };
    const Motion once = loop(1), often = loop(2.5);
    double fastest = 0, slowest = 1e9;
    for (double t = 0; t < duration / 2.5; t += 0.5) {
      EXPECT_LT((often(t).translation - once(2.5 * t).translation).norm(), 0.1) << name;
      EXPECT_LT((often(t).translation - often(t + duration / 2.5).translation).norm(), 0.1) << name;
      const double step = (once(t + 0.5).translation - once(t).translation).norm();
      fastest = std::max(fastest, step), slowest = std::min(slowest, step);
    }
    if (name[0] == 't') {
      EXPECT_LT(fastest, 1.25 * slowest) << name;  // the room's circuit slows down in its corners
    }
  }
}

TEST(Motion, OrbitKeepsTheCentreInView) {
  for (const char* name : {"street", "room", "corridor", "board", "town"}) {
    const World& world = world_of(name);
    const Motion motion = motion_in(world, "orbit", 20);
    for (double t = 0; t < 20; t += 0.5) {
      const Vector3d seen = motion(t).inverse() * world.stage.centre;
      EXPECT_LT(std::hypot(seen.x(), seen.y()) / seen.z(), 0.12) << name << " at " << t;
      EXPECT_GT(seen.z(), 0);
    }
  }
}

TEST(Motion, DollyKeepsTheSizeOfTheCentreWhileTheLensZooms) {
  const World& board = world_of("board");
  const Motion motion = *make_motion(board.stage, board.habit, {"dolly", 6, 1, 0, 2.5});
  for (const double time : {0.0, 1.5, 3.0, 6.0}) {
    const double distance = (motion(time).inverse() * board.stage.centre).norm();
    EXPECT_NEAR(distance / zoom_factor(2.5, time / 6), board.stage.orbit_radius, 0.05) << time;
  }
}

TEST(Motion, UnknownNameIsRefusedWithTheKnownOnes) {
  const World& world = world_of("board");
  const Result<Motion> motion = make_motion(world.stage, world.habit, {"fly", 1, 1, 0});
  ASSERT_FALSE(motion);
  EXPECT_NE(motion.error().message.find("fly"), std::string::npos);
  EXPECT_NE(motion.error().message.find("handheld"), std::string::npos);
}

}  // namespace
}  // namespace raysfm::synth
