#include <cmath>
#include <numbers>

#include "raysfm/worlds/builder.h"

namespace raysfm::synth {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

// Rectangle [x0, x1] x [z0, z1] walked around with z0 first, anticlockwise seen from above with z up the
// page.
std::vector<Vector3d> rectangle(double x0, double x1, double z0, double z1, double eye, double spacing) {
  const Vector2d corners[] = {{x0, z0}, {x1, z0}, {x1, z1}, {x0, z1}};
  std::vector<Vector3d> points;
  for (int i = 0; i < 4; ++i) {
    const Vector2d a = corners[i], b = corners[(i + 1) % 4];
    const int steps = std::max(1, static_cast<int>(std::lround((b - a).norm() / spacing)));
    for (int k = 0; k < steps; ++k) {
      const Vector2d p = a + (b - a) * k / steps;
      points.emplace_back(p.x(), -eye, p.y());
    }
  }
  return points;
}

void hang_pictures(Builder& b, const Vector2d& from, const Vector2d& to, double out, double spacing) {
  Rng& r = b.random();
  const Vector2d along = (to - from).normalized(), inward(along.y(), -along.x());
  const double length = (to - from).norm();
  for (double at = r.uniform(0.3, 0.8); at < length - 1.0; at += spacing * r.uniform(0.8, 1.3)) {
    const double w = r.uniform(0.5, 1.1), h = r.uniform(0.45, 0.9), low = r.uniform(1.05, 1.5);
    const Vector2d a = from + at * along + out * inward;
    b.wall(a, a + w * along, low, low + h, b.finish(Pattern::kPainting, static_cast<int>(r.index(12))));
  }
}

void build_table(Builder& b, const Vector3d& foot, double yaw) {
  Rng& r = b.random();
  const Finish wood = b.finish(Pattern::kPlanks, 2);
  const Vector3d x(std::cos(yaw), 0, -std::sin(yaw)), z(std::sin(yaw), 0, std::cos(yaw)), up(0, -1, 0);
  for (const double i : {-0.7, 0.7}) {
    for (const double k : {-0.38, 0.38}) b.box(foot + i * x + k * z, {0.07, 0.72, 0.07}, yaw, wood, wood);
  }
  b.box(foot + 0.70 * up, {1.6, 0.05, 0.9}, yaw, wood, wood);
  for (int i = 0; i < 9; ++i) {
    const Vector3d place = foot + 0.75 * up + r.uniform(-0.65, 0.65) * x + r.uniform(-0.35, 0.35) * z;
    const Pattern look = i % 3 == 0 ? Pattern::kPainting : i % 3 == 1 ? Pattern::kSign : Pattern::kShopFront;
    const Finish f = b.finish(look, static_cast<int>(r.index(5)));
    if (i % 4 == 3) {
      const double radius = r.uniform(0.05, 0.1);
      b.ellipsoid(place + radius * up, {radius, radius, radius},
                  b.finish(Pattern::kCloth, static_cast<int>(r.index(4))));
    } else {
      b.box(place, {r.uniform(0.08, 0.28), r.uniform(0.04, 0.3), r.uniform(0.08, 0.22)}, r.uniform(0, 3), f,
            f);
    }
  }
}

void build_chair(Builder& b, const Vector3d& foot, double yaw) {
  const Finish wood = b.finish(Pattern::kPlanks, 1, Colour(0.8f, 0.7f, 0.6f));
  const Finish seat =
      b.finish(Pattern::kCloth, static_cast<int>(b.random().index(4)), Colour(1.2f, 0.7f, 0.6f), 0.3f);
  const Vector3d x(std::cos(yaw), 0, -std::sin(yaw)), z(std::sin(yaw), 0, std::cos(yaw)), up(0, -1, 0);
  for (const double i : {-0.2, 0.2}) {
    for (const double k : {-0.2, 0.2}) b.box(foot + i * x + k * z, {0.04, 0.44, 0.04}, yaw, wood, wood);
  }
  b.box(foot + 0.42 * up, {0.46, 0.07, 0.46}, yaw, seat, seat);
  b.box(foot + 0.45 * up - 0.21 * z, {0.44, 0.5, 0.04}, yaw, seat, wood);
}

void build_plant(Builder& b, const Vector3d& foot) {
  const Finish pot = b.finish(Pattern::kTiles, 0, Colour(1.0f, 0.6f, 0.45f));
  b.box(foot, {0.34, 0.4, 0.34}, 0.4, pot, b.finish(Pattern::kFoliage, 0));
  for (int i = 0; i < 5; ++i) {
    const Vector3d place(b.random().uniform(-0.2, 0.2), b.random().uniform(-1.2, -0.6),
                         b.random().uniform(-0.2, 0.2));
    const double r = b.random().uniform(0.13, 0.24);
    b.ellipsoid(foot + place, {r, r, r}, b.finish(Pattern::kFoliage, 1, Colour::Ones(), 0.2f));
  }
}

void soften_light(World& w) {
  w.light.toward = Eigen::Vector3f(0.35f, -0.75f, -0.56f);
  w.light.ambient = 0.68f;
}

}  // namespace

World build_room(Builder b) {
  constexpr double kX = 3.4, kZ = 2.8, kHigh = 2.7;
  Rng& r = b.random();
  const auto paint = [&] { return b.finish(Pattern::kPlaster, 0, Colour(1.05f, 1.0f, 0.9f), 0.1f); };
  b.level(-kX, kX, -kZ, kZ, 0, b.finish(Pattern::kPlanks, 0));
  b.level(-kX, kX, -kZ, kZ, -kHigh, b.finish(Pattern::kPlaster, 1, Colour(1.15f, 1.15f, 1.12f)));
  b.wall({-kX, kZ}, {kX, kZ}, 0, kHigh, paint());
  b.wall({kX, kZ}, {kX, -kZ}, 0, kHigh, b.finish(Pattern::kBrick, 0));
  b.wall({kX, -kZ}, {-kX, -kZ}, 0, kHigh, paint());
  b.wall({-kX, -kZ}, {-kX, kZ}, 0, kHigh, paint());
  hang_pictures(b, {-kX + 1.3, kZ}, {kX, kZ}, 0.02, 1.5);
  hang_pictures(b, {kX, kZ}, {kX, -kZ}, 0.02, 1.4);
  hang_pictures(b, {kX, -kZ}, {-kX, -kZ}, 0.02, 1.6);
  b.wall({-kX + 0.015, -0.9}, {-kX + 0.015, 1.1}, 0.9, 2.3,
         b.finish(Pattern::kWindow, 4, Colour(1.9f, 1.9f, 1.8f)));
  b.wall({-2.2, -kZ + 0.015}, {-3.1, -kZ + 0.015}, 0, 2.1, b.finish(Pattern::kDoor, 2));
  for (const double x : {-2.75, -1.7}) {
    b.box({x, 0, kZ - 0.17}, {1.0, 2.1, 0.32}, 0, b.finish(Pattern::kBooks, x < -2 ? 0 : 1),
          b.finish(Pattern::kPlanks, 1));
  }
  b.box({kX - 0.2, 0, 1.3}, {0.36, 1.2, 1.5}, 0, b.finish(Pattern::kBooks, 2), b.finish(Pattern::kPlanks, 1));
  b.box({kX - 0.45, 0, -1.6}, {0.8, 0.8, 1.7}, 0, b.finish(Pattern::kCloth, 1), b.finish(Pattern::kCloth, 3));
  b.level(-1.6, 1.6, -1.2, 1.2, -0.008, b.finish(Pattern::kRug, 1));
  build_table(b, {0.1, 0, 0.1}, 0.25);
  build_chair(b, {-0.7, 0, -0.75}, 0.1);
  build_chair(b, {0.9, 0, 0.95}, 3.3);
  build_chair(b, {1.3, 0, -0.2}, 4.9);
  build_plant(b, {kX - 0.4, 0, kZ - 0.4});
  build_plant(b, {-kX + 0.5, 0, -1.9});
  const Finish shade = b.finish(Pattern::kCloth, 2, Colour(1.5f, 1.35f, 1.f));
  b.ellipsoid({0.1, -2.15, 0.1}, {0.28, 0.2, 0.28}, shade);
  b.box({0.1, -2.3, 0.1}, {0.02, 0.4, 0.02}, 0, shade, shade);
  for (int i = 0; i < 4; ++i) {
    b.box({-kX + 0.35 + 0.1 * i, 0, 2.0 - 0.42 * i}, {0.35, r.uniform(0.3, 0.7), 0.35}, r.uniform(-0.4, 0.4),
          b.finish(Pattern::kShopFront, i), b.finish(Pattern::kSign, i));
  }

  World& w = b.world();
  soften_light(w);
  Stage& s = w.stage;
  s.spacing = 0.4;
  // Round the table, once and a bit.
  const std::vector<Vector3d> round = rectangle(-2.0, 2.0, -1.6, 1.6, 1.5, s.spacing);
  for (size_t i = 0; i < 44; ++i) s.way.push_back(round[i % round.size()]);
  s.straight_from = {-1.9, -1.5, -1.9};
  s.straight_length = 3.2;
  s.circuit = rectangle(-2.1, 2.1, -1.6, 1.6, 1.5, s.spacing);
  s.eye = {-0.9, -1.5, -1.8};
  s.eye_yaw_deg = 20;
  s.centre = {0.1, -0.85, 0.1};
  s.orbit_radius = 1.75;
  s.orbit_height = 0.75;
  w.habit = {"handheld", 300, 15};
  return b.finish_world();
}

World build_corridor(Builder b, double length) {
  // A ring of four passages round a block, so that one can walk for ever and come back.
  constexpr double kWidth = 2.4, kHigh = 2.6, kEye = 1.6;
  const double x1 = 10 + kWidth, z1 = std::max(16.0, 0.5 * length - 8), half = 0.5 * kWidth;
  Rng& r = b.random();
  b.level(-half, x1 + half, -half, z1 + half, 0, b.finish(Pattern::kTiles, 0));
  b.level(-half, x1 + half, -half, z1 + half, -kHigh,
          b.finish(Pattern::kTiles, 1, Colour(1.15f, 1.15f, 1.15f)));
  const auto side = [&](const Vector2d& from, const Vector2d& to) {
    b.wall(from, to, 0, 0.95,
           b.finish(Pattern::kPlanks, static_cast<int>(r.index(2)), Colour(0.8f, 0.85f, 0.9f)));
    b.wall(from, to, 0.95, kHigh,
           b.finish(Pattern::kPlaster, static_cast<int>(r.index(2)), Colour(1.f, 1.f, 0.92f)));
    const Vector2d along = (to - from).normalized(), inward(along.y(), -along.x());
    for (double at = r.uniform(1.0, 2.5); at < (to - from).norm() - 2; at += r.uniform(2.8, 4.2)) {
      const Vector2d a = from + at * along + 0.03 * inward;
      b.wall(a, a + 0.95 * along, 0, 2.1, b.finish(Pattern::kDoor, static_cast<int>(r.index(6))));
      const Vector2d plate = a + 1.1 * along;
      b.wall(plate, plate + 0.3 * along, 1.4, 1.6, b.finish(Pattern::kSign, static_cast<int>(r.index(9))));
      const Vector2d board = a + 1.6 * along;
      b.wall(board, board + 0.9 * along, 1.1, 1.8,
             b.finish(Pattern::kPainting, static_cast<int>(r.index(12))));
      if (r.index(3) == 0) build_plant(b, {board.x() + 0.25 * inward.x(), 0, board.y() + 0.25 * inward.y()});
      const Vector2d pillar = a - 0.5 * along;
      b.box({pillar.x(), 0, pillar.y()}, {0.3, kHigh, 0.3}, 0, b.finish(Pattern::kAshlar, 0),
            b.finish(Pattern::kPlain, 0));
    }
  };
  side({-half, -half}, {-half, z1 + half});
  side({-half, z1 + half}, {x1 + half, z1 + half});
  side({x1 + half, z1 + half}, {x1 + half, -half});
  side({x1 + half, -half}, {-half, -half});
  side({half, z1 - half}, {half, half});
  side({x1 - half, z1 - half}, {half, z1 - half});
  side({x1 - half, half}, {x1 - half, z1 - half});
  side({half, half}, {x1 - half, half});
  for (double z = 1.5; z < z1; z += 3) {
    for (const double x : {0.0, x1}) {
      b.level(x - 0.15, x + 0.15, z, z + 1.2, -kHigh + 0.02,
              b.finish(Pattern::kPlain, 0, Colour(1.4f, 1.4f, 1.35f)));
    }
  }

  World& w = b.world();
  soften_light(w);
  Stage& s = w.stage;
  s.spacing = 0.7;
  s.circuit = rectangle(0, x1, 0, z1, kEye, s.spacing);
  std::reverse(s.circuit.begin() + 1, s.circuit.end());  // along z first
  const int points = static_cast<int>((length + 2.5 * s.spacing) / s.spacing) + 1;
  for (int i = 0; i < points; ++i) s.way.push_back(s.circuit[static_cast<size_t>(i + 1) % s.circuit.size()]);
  s.straight_from = {0, -kEye, 0};
  s.straight_length = z1 - 1;
  s.eye = {0, -kEye, 1.5};
  s.centre = {0, -1.4, 0.5 * z1};
  s.orbit_radius = 0.55;
  s.orbit_height = 0.1;
  w.habit = {"drive", 400, 10};
  return b.finish_world();
}

World build_board(Builder b) {
  // Two boards of 9 x 7 squares of 0.1 m that meet in a vertical edge at x = z = 0, like an open book.
  constexpr double kSquare = 0.1, kBorder = 0.08, kRoom = 7;
  constexpr int kColumns = 9, kRows = 7;
  const double s = std::sqrt(0.5);
  const auto flat = [&](const Colour& tint) {
    Finish f = b.finish(Pattern::kPlain, 0, tint, 0.f);
    f.stains = f.grain = 0.f;
    return f;
  };
  const Vector3d down = Vector3d::UnitY();
  World& w = b.world();
  for (const double turn : {-1.0, 1.0}) {
    // From left to right as the camera at negative z sees it: the left board ends at the edge, the right one
    // begins.
    const Vector3d right(s, 0, turn < 0 ? s : -s), near = Vector3d(0, 0, -0.004).eval();
    const double width = kColumns * kSquare, height = kRows * kSquare;
    const Vector3d first = turn < 0 ? Vector3d(-(width + 2 * kBorder) * right) : Vector3d::Zero();
    const Vector3d corner = first + Vector3d(0, -0.5 * height - kBorder, 0);
    b.quad(corner, right, down, width + 2 * kBorder, height + 2 * kBorder, flat(Colour(1.27f, 1.27f, 1.27f)));
    const Vector3d squares = corner + kBorder * right + kBorder * down + near;
    Finish checks = flat(Colour::Ones());
    checks.texture = w.materials->find(Pattern::kCheckerboard, 0);
    checks.period = period_of(Pattern::kCheckerboard);
    checks.shift_u = checks.shift_v = 0.f;
    b.quad(squares, right, down, width, height, checks);
    for (int y = 1; y < kRows; ++y) {
      for (int x = 1; x < kColumns; ++x) w.landmarks.push_back(squares + kSquare * (x * right + y * down));
    }
  }
  b.level(-kRoom, kRoom, -kRoom, kRoom, 0.6, b.finish(Pattern::kPlanks, 0));
  b.wall({-kRoom, kRoom}, {kRoom, kRoom}, -0.6, 2.2, b.finish(Pattern::kBrick, 0));
  b.wall({-kRoom, -kRoom}, {-kRoom, kRoom}, -0.6, 2.2, b.finish(Pattern::kPlaster, 0));
  b.wall({kRoom, kRoom}, {kRoom, -kRoom}, -0.6, 2.2, b.finish(Pattern::kPlaster, 1));
  b.wall({kRoom, -kRoom}, {-kRoom, -kRoom}, -0.6, 2.2, b.finish(Pattern::kAshlar, 0));
  b.level(-kRoom, kRoom, -kRoom, kRoom, -2.2, b.finish(Pattern::kPlaster, 0));
  hang_pictures(b, {-kRoom, kRoom}, {kRoom, kRoom}, 0.02, 1.3);

  soften_light(w);
  w.light.toward = Eigen::Vector3f(0.f, -0.45f, -0.89f);
  Stage& stage = w.stage;
  stage.spacing = 0.2;
  for (int i = 0; i < 14; ++i) stage.way.emplace_back(-0.6 + 0.1 * i, -0.1, -2.4 + 0.1 * i);
  stage.circuit = rectangle(-0.6, 0.6, -2.6, -1.6, 0.1, stage.spacing);
  stage.straight_from = {0, -0.1, -2.6};
  stage.straight_length = 1.2;
  stage.eye = {0, -0.1, -1.8};
  stage.centre = {0, 0, 0};
  stage.orbit_radius = 2.2;
  stage.orbit_height = 0.15;
  stage.orbit_arc_deg = 70;
  stage.orbit_start_deg = -35;
  w.habit = {"orbit", 60, 10};
  return b.finish_world();
}

}  // namespace raysfm::synth
