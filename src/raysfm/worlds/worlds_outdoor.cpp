#include <cmath>
#include <numbers>

#include "raysfm/worlds/builder.h"

namespace raysfm::synth {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kEye = 1.6;         // metres, of the camera above the road
constexpr double kHalfRoad = 3.2;    // kerb to kerb: twice this
constexpr double kHalfStreet = 6.2;  // front to front
constexpr double kPi = std::numbers::pi;

// Road, kerbs and pavements along z, in stretches short enough for single precision.
void build_road(Builder& b, double z0, double z1) {
  const int stretches = std::max(1, static_cast<int>((z1 - z0) / 30.0));
  for (int i = 0; i < stretches; ++i) {
    const double a = z0 + (z1 - z0) * i / stretches, c = z0 + (z1 - z0) * (i + 1) / stretches;
    b.level(-18, 18, a, c, 0.03, b.finish(Pattern::kAsphalt, 0));  // seen between and behind the houses
    b.level(-kHalfRoad, kHalfRoad, a, c, 0, b.finish(Pattern::kAsphalt, 0, Colour::Ones(), 0.03f));
    for (const double side : {-1.0, 1.0}) {
      const double kerb = side * kHalfRoad, front = side * (kHalfStreet + 1.2);
      b.level(std::min(kerb, front), std::max(kerb, front), a, c, -0.13,
              b.finish(Pattern::kPaving, 0, Colour::Ones(), 0.05f));
      b.wall({kerb, a}, {kerb, c}, 0, 0.13, b.finish(Pattern::kPlain, 0, Colour(0.9f, 0.9f, 0.88f)));
    }
  }
  for (double z = z0 + 1; z < z1 - 2; z += 5) {
    b.level(-0.07, 0.07, z, z + 2, -0.004, b.finish(Pattern::kPlain, 0, Colour(1.25f, 1.25f, 1.2f)));
  }
}

void build_car(Builder& b, const Vector3d& foot, double yaw) {
  Rng& r = b.random();
  const Colour paint(r.uniform(0.2, 1.2), r.uniform(0.2, 1.1), r.uniform(0.2, 1.1));
  const Finish body = b.finish(Pattern::kPlain, 0, paint);
  const Finish glass = b.finish(Pattern::kWindow, static_cast<int>(r.index(6)), Colour(0.8f, 0.85f, 0.9f));
  const Finish dark = b.finish(Pattern::kPlain, 0, Colour(0.18f, 0.18f, 0.2f));
  const Vector3d up(0, -1, 0), forward(std::sin(yaw), 0, std::cos(yaw)),
      right(std::cos(yaw), 0, -std::sin(yaw));
  b.box(foot + 0.28 * up, {1.72, 0.62, 4.2}, yaw, body, body);
  b.box(foot + 0.88 * up - 0.25 * forward, {1.5, 0.55, 2.1}, yaw, glass, body);
  for (const double x : {-0.8, 0.8}) {
    for (const double z : {-1.35, 1.3})
      b.ellipsoid(foot + 0.32 * up + x * right + z * forward, {0.12, 0.32, 0.32}, dark);
  }
  b.quad(foot + 0.75 * up + 2.11 * forward + 0.26 * right, -right, -up, 0.52, 0.12,
         b.finish(Pattern::kSign, static_cast<int>(r.index(9)), Colour(1.1f, 1.1f, 1.1f)));
  b.quad(foot + 0.75 * up - 2.11 * forward - 0.26 * right, right, -up, 0.52, 0.12,
         b.finish(Pattern::kSign, static_cast<int>(r.index(9)), Colour(1.1f, 1.1f, 1.1f)));
}

void build_market_stall(Builder& b, const Vector3d& foot) {
  Rng& r = b.random();
  const Finish wood = b.finish(Pattern::kPlanks, 1);
  b.box(foot, {1.2, 0.85, 1.8}, r.uniform(-0.1, 0.1),
        b.finish(Pattern::kShopFront, static_cast<int>(r.index(5))), wood);
  for (const double z : {-0.85, 0.85}) b.box(foot + Vector3d(0.5, 0, z), {0.06, 2.2, 0.06}, 0, wood, wood);
  b.box(foot + Vector3d(0, -2.2, 0), {1.5, 0.12, 2.1}, 0,
        b.finish(Pattern::kCloth, static_cast<int>(r.index(4))), b.finish(Pattern::kCloth, 2));
}

// What stands and walks between the fronts.
void furnish_street(Builder& b, double z0, double z1) {
  Rng& r = b.random();
  int place = 0;
  for (double z = z0 + 2; z < z1 - 3; z += r.uniform(4.0, 6.0), ++place) {
    const double side = r.index(2) ? 1.0 : -1.0;
    const double kerb = side * (kHalfRoad + 0.5);
    switch (r.index(6)) {
      case 0:
        b.tree({kerb, 0, z}, r.uniform(3.5, 5.5));
        break;
      case 1:
        b.lamp_post({kerb, 0, z}, 3.8);
        break;
      case 2:
        build_market_stall(b, {side * (kHalfStreet - 1.2), -0.13, z});
        break;
      case 3:
        build_car(b, {side * (kHalfRoad - 0.95), 0, z}, side > 0 ? 0 : kPi);
        break;
      case 4:
        b.box({kerb, -0.13, z}, {0.5, 0.95, 0.5}, r.uniform(0, 1), b.finish(Pattern::kPlanks, 2),
              b.finish(Pattern::kFoliage, 0));
        break;
      default:
        b.box({side * (kHalfStreet - 0.5), -0.13, z}, {0.35, 1.2, 0.8}, r.uniform(-0.4, 0.4),
              b.finish(Pattern::kPainting, static_cast<int>(r.index(6))), b.finish(Pattern::kPlain, 0));
    }
  }
}

void people_street(Builder& b, double z0, double z1, double every) {
  Rng& r = b.random();
  for (double z = z0; z < z1; z += every * r.uniform(0.7, 1.3)) {
    if (r.index(5) < 3) {  // across the road
      const double reach = kHalfStreet - 0.6;
      b.walker({-reach, 0, z}, {reach, 0, z + r.uniform(-2.5, 2.5)});
    } else {  // along the pavement
      const double x = (r.index(2) ? 1.0 : -1.0) * r.uniform(kHalfRoad + 1.0, kHalfStreet - 0.7);
      b.walker({x, -0.13, z - 5}, {x, -0.13, z + 6});
    }
  }
}

// There on the right, half-turn of radius `half_width`, back on the left.
std::vector<Vector3d> stadium(double z0, double z1, double half_width, double spacing) {
  std::vector<Vector3d> points;
  const int straight = std::max(2, static_cast<int>((z1 - z0) / spacing));
  const int turn = std::max(3, static_cast<int>(kPi * half_width / spacing));
  const auto half = [&](double from, double to, double side) {
    for (int i = 0; i < straight; ++i)
      points.emplace_back(side * half_width, -kEye, from + (to - from) * i / straight);
    for (int i = 0; i < turn; ++i) {
      const double angle = kPi * i / turn;
      points.emplace_back(side * half_width * std::cos(angle), -kEye,
                          to + side * half_width * std::sin(angle));
    }
  };
  half(z0, z1, 1.0);
  half(z1, z0, -1.0);
  return points;
}

// The same line with points every `spacing` metres along it, so that a curve through them has constant speed.
std::vector<Vector3d> evenly(const std::vector<Vector3d>& line, double spacing) {
  std::vector<Vector3d> points = {line.front()};
  double until = spacing;  // metres to the next point
  for (size_t i = 1; i < line.size(); ++i) {
    const Vector3d way = line[i] - line[i - 1];
    const double length = way.norm();
    for (; until <= length; until += spacing) points.push_back(line[i - 1] + until / length * way);
    until -= length;
  }
  return points;
}

// A turn to the left about a point of the street.
struct Turn {
  double z, radius;  // metres
};

// Out on the right from 0 to z1, round the far circle, back on the left, round the near one: closed, with
// points at even distances of about `spacing`.
std::vector<Vector3d> there_and_back(double z1, double lane, const Turn& far, const Turn& near,
                                     double spacing) {
  std::vector<Vector3d> line = {{lane, -kEye, 0}, {lane, -kEye, z1}};
  const auto turn = [&](const Turn& t, int from_degrees) {
    for (int degrees = from_degrees; degrees <= from_degrees + 280; degrees += 10) {
      const double a = degrees * kPi / 180;
      line.emplace_back(t.radius * std::cos(a), -kEye, t.z + t.radius * std::sin(a));
    }
  };
  turn(far, -50);
  line.insert(line.end(), {{-lane, -kEye, z1}, {-lane, -kEye, 0}});
  turn(near, 130);
  line.push_back(line.front());
  double length = 0;
  for (size_t i = 1; i < line.size(); ++i) length += (line[i] - line[i - 1]).norm();
  const double steps = std::round(length / spacing);
  std::vector<Vector3d> points = evenly(line, length / steps);
  points.resize(static_cast<size_t>(steps));  // the first one follows the last
  return points;
}

// Copies of all that is there, every `period` metres along z.
void repeat(Builder& b, double period, int copies) {
  World& w = b.world();
  const size_t quads = w.quads.size(), ellipsoids = w.ellipsoids.size();
  for (int i = 1; i <= copies; ++i) {
    const Vector3d away(0, 0, period * i);
    for (size_t k = 0; k < quads; ++k) w.quads.push_back(w.quads[k]), w.quads.back().corner += away;
    for (size_t k = 0; k < ellipsoids; ++k) {
      w.ellipsoids.push_back(w.ellipsoids[k]);
      w.ellipsoids.back().centre += away;
    }
  }
}

}  // namespace

World build_street(Builder b, double length) {
  const double z0 = -12, z1 = length + 22;
  build_road(b, z0, z1);
  build_facades(b, {-kHalfStreet, z0}, {-kHalfStreet, z1});
  build_facades(b, {kHalfStreet, z1}, {kHalfStreet, z0});
  build_facades(b, {-kHalfStreet - 1, z1}, {kHalfStreet + 1, z1});  // the street ends at a house
  build_facades(b, {kHalfStreet + 1, z0}, {-kHalfStreet - 1, z0});
  furnish_street(b, 1, z1 - 2);
  people_street(b, 5, z1 - 4, 7.0);

  World& w = b.world();
  w.open_air = true;
  Stage& s = w.stage;
  s.spacing = 2;
  for (double z = 0; z <= length + 2.5 * s.spacing; z += s.spacing) {
    s.way.emplace_back(0.45 * std::sin(2 * kPi * z / 46.0), -kEye, z);  // gentle changes of lane
  }
  s.straight_from = {0, -kEye, 0};
  s.straight_length = length;
  s.circuit = stadium(4, std::max(14.0, 0.5 * length), 1.6, s.spacing);
  s.eye = {0, -kEye, 3};
  s.centre = {0, -1.9, 0.5 * length};
  s.orbit_radius = 2.0;
  s.orbit_height = 0.2;
  w.habit = {"drive", 445, 7.5};
  return b.finish_world();
}

World build_town(Builder b, double length) {
  // The way out and back are one street with a square at its far end, where the half-turn is.
  constexpr double kTurn = 6.5, kLane = 1.5;
  constexpr double kSquareLength = 54;  // metres of the way in the square
  const double reach = std::max(10.0, 0.5 * (length - kSquareLength));
  const double z0 = -12, z1 = reach, square = z1 + 34;
  build_road(b, z0, z1);
  build_facades(b, {-kHalfStreet, z0}, {-kHalfStreet, z1});
  build_facades(b, {kHalfStreet, z1}, {kHalfStreet, z0});
  build_facades(b, {kHalfStreet + 1, z0}, {-kHalfStreet - 1, z0});
  constexpr double kHalfSquare = 15;
  build_facades(b, {-kHalfSquare, z1}, {-kHalfSquare, square});
  build_facades(b, {-kHalfSquare, square}, {kHalfSquare, square});
  build_facades(b, {kHalfSquare, square}, {kHalfSquare, z1});
  build_facades(b, {-kHalfStreet, z1}, {-kHalfSquare, z1});
  build_facades(b, {kHalfSquare, z1}, {kHalfStreet, z1});
  b.level(-kHalfSquare - 1, kHalfSquare + 1, z1 - 1, square + 1, 0.01, b.finish(Pattern::kCobbles, 0));
  for (int i = 0; i < 6; ++i) {
    const double x = (i % 2 ? 11.5 : -11.5), z = z1 + 6 + 11.0 * (i / 2);
    b.tree({x, 0, z}, b.random().uniform(4.5, 7.0));
  }
  b.box({0, 0, z1 + 13}, {2.4, 1.0, 2.4}, 0.3, b.finish(Pattern::kAshlar, 0), b.finish(Pattern::kPaving, 0));
  b.box({0, -1.0, z1 + 13}, {0.9, 3.2, 0.9}, 0.3, b.finish(Pattern::kSign, 4), b.finish(Pattern::kPlain, 0));
  furnish_street(b, 1, z1 - 2);
  people_street(b, 9, square - 6, 14.0);

  World& w = b.world();
  w.open_air = true;
  Stage& s = w.stage;
  s.spacing = 2;
  const double centre = z1 + 13;
  // Out on the right, round the monument to the left, back on the left.
  std::vector<Vector3d> line = {{kLane, -kEye, 0}, {kLane, -kEye, z1}};
  for (int degrees = -50; degrees <= 230; degrees += 10) {
    const double a = degrees * kPi / 180;
    line.emplace_back(kTurn * std::cos(a), -kEye, centre + kTurn * std::sin(a));
  }
  line.insert(line.end(), {{-kLane, -kEye, z1}, {-kLane, -kEye, -9}});
  s.way = evenly(line, s.spacing);
  s.straight_from = line.front();
  s.straight_length = z1;
  s.circuit = there_and_back(z1, kLane, {centre, kTurn}, {-5, 3.5}, s.spacing);
  s.eye = {0, -kEye, 3};
  s.centre = {0, -2.2, centre};
  s.orbit_radius = 8;
  s.orbit_height = -0.6;
  w.habit = {"drive", 1500, 7.5};
  return b.finish_world();
}

World build_terrace(Builder b, double length) {
  constexpr double kPeriod = 10, kLane = 1.5, kTurn = 3.5;
  const int periods = static_cast<int>(std::ceil((length + 40) / kPeriod));
  const double z0 = -2 * kPeriod, z1 = z0 + periods * kPeriod;
  build_road(b, z0, z0 + kPeriod);
  build_facades(b, {-kHalfStreet, z0}, {-kHalfStreet, z0 + kPeriod});
  build_facades(b, {kHalfStreet, z0 + kPeriod}, {kHalfStreet, z0});
  furnish_street(b, z0, z0 + kPeriod);
  repeat(b, kPeriod, periods - 1);
  build_facades(b, {-kHalfStreet - 1, z1}, {kHalfStreet + 1, z1});
  build_facades(b, {kHalfStreet + 1, z0}, {-kHalfStreet - 1, z0});

  World& w = b.world();
  w.open_air = true;
  Stage& s = w.stage;
  s.spacing = 2;
  for (double z = 0; z <= length + 2.5 * s.spacing; z += s.spacing) s.way.emplace_back(0, -kEye, z);
  s.straight_from = s.way.front();
  s.straight_length = length;
  s.circuit = there_and_back(length, kLane, {length + 5, kTurn}, {-5, kTurn}, s.spacing);
  s.eye = {0, -kEye, 3};
  s.centre = {0, -1.9, 0.5 * length};
  s.orbit_radius = 2.0;
  s.orbit_height = 0.2;
  w.habit = {"drive", 400, 7.5};
  return b.finish_world();
}

}  // namespace raysfm::synth
