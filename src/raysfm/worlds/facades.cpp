#include <cmath>

#include "raysfm/worlds/builder.h"

namespace raysfm::synth {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

// The front of one house: a wall with its own two coordinates, metres along it and above the ground.
class Front {
 public:
  Front(Builder& b, const Vector2d& origin, const Vector2d& along)
      : b_(b), origin_(origin), along_(along), out_(along.y(), -along.x()) {}

  // Rectangle [left, right] x [low, high] standing `out` metres before the wall.
  void patch(double left, double right, double low, double high, double out, const Finish& finish) {
    const Vector2d base = origin_ + out * out_;
    b_.wall(base + left * along_, base + right * along_, low, high, finish);
  }

  // Box on the wall, [left, right] x [low, high], `depth` metres thick. Its yaw turns x to `along`.
  void ledge(double left, double right, double low, double high, double depth, const Finish& finish) {
    const Vector2d foot = origin_ + 0.5 * (left + right) * along_ + 0.5 * depth * out_;
    const double yaw = std::atan2(-along_.y(), along_.x());
    b_.box({foot.x(), -low, foot.y()}, {right - left, high - low, depth}, yaw, finish, finish);
    // Its underside is what one sees of a ledge above one's head.
    const Vector2d corner = origin_ + left * along_;
    b_.quad({corner.x(), -low, corner.y()}, {along_.x(), 0, along_.y()}, {out_.x(), 0, out_.y()},
            right - left, depth, finish);
  }

  // Board that sticks out of the wall at `at`, readable from both sides.
  void banner(double at, double low, double high, double reach, const Finish& finish) {
    const Vector2d a = origin_ + at * along_ + 0.25 * out_;
    b_.wall(a, a + reach * out_, low, high, finish);
  }

 private:
  Builder& b_;
  Vector2d origin_, along_, out_;
};

struct Style {
  Finish wall, trim;
  int window;
  double window_width, window_height, storey;
};

Style random_style(Builder& b) {
  Rng& r = b.random();
  static constexpr Pattern kWalls[] = {Pattern::kBrick,   Pattern::kPlaster, Pattern::kAshlar,
                                       Pattern::kPlaster, Pattern::kBrick,   Pattern::kPlanks};
  static const Colour kTints[] = {{1.f, 1.f, 1.f},     {1.1f, 0.95f, 0.75f}, {0.85f, 0.95f, 1.05f},
                                  {1.15f, 0.8f, 0.7f}, {0.9f, 1.05f, 0.85f}, {1.1f, 1.05f, 0.95f}};
  const Pattern pattern = kWalls[r.index(6)];
  const Colour tint = pattern == Pattern::kPlanks ? Colour(kTints[r.index(6)] * 0.9f) : kTints[r.index(6)];
  return {b.finish(pattern, static_cast<int>(r.index(2)), tint),
          b.finish(Pattern::kPlain, 0, Colour(1.15f, 1.12f, 1.05f), 0.15f),
          static_cast<int>(r.index(3)),
          r.uniform(0.95, 1.5),
          r.uniform(1.35, 1.9),
          r.uniform(2.9, 3.5)};
}

void build_window(Builder& b, Front& front, const Style& style, double centre, double sill) {
  const double w = 0.5 * style.window_width, top = sill + style.window_height;
  Rng& r = b.random();
  const int look = r.index(4) == 0 ? 3 : style.window;
  front.patch(centre - w, centre + w, sill, top, 0.015, b.finish(Pattern::kWindow, 6 * look + r.index(6)));
  front.ledge(centre - w - 0.12, centre + w + 0.12, sill - 0.12, sill, 0.18, style.trim);
  front.ledge(centre - w - 0.10, centre + w + 0.10, top, top + 0.18, 0.09, style.trim);
  const uint32_t extra = r.index(10);
  if (extra < 2) {
    front.ledge(centre - w, centre + w, sill, sill + 0.22, 0.26,
                b.finish(Pattern::kFoliage, 0, {1.3f, 1.0f, 0.9f}));
  } else if (extra < 4) {
    const Finish wood =
        b.finish(Pattern::kPlanks, 3, Colour(r.uniform(0.5, 1), r.uniform(0.7, 1.2), r.uniform(0.6, 1.2)));
    front.patch(centre - w - 0.5, centre - w - 0.04, sill, top, 0.05, wood);
    front.patch(centre + w + 0.04, centre + w + 0.5, sill, top, 0.05, wood);
  }
}

void build_ground_floor(Builder& b, Front& front, const Style& style, double width) {
  Rng& r = b.random();
  if (r.index(5) < 2 && width > 6) {
    const double door = r.uniform(0.6, 1.2);
    front.patch(door, door + 1.0, 0, 2.2, 0.02, b.finish(Pattern::kDoor, static_cast<int>(r.index(6))));
    const double left = door + 1.5, right = width - 0.5, half = 0.5 * (left + right);
    const Pattern display = r.index(4) == 0 ? Pattern::kShutter : Pattern::kShopFront;
    front.patch(left, half - 0.1, 0.4, 2.5, 0.02, b.finish(display, static_cast<int>(r.index(5))));
    front.patch(half + 0.1, right, 0.4, 2.5, 0.02,
                b.finish(Pattern::kShopFront, static_cast<int>(r.index(5))));
    front.ledge(0.3, width - 0.3, 2.6, 3.15, 0.22, b.finish(Pattern::kSign, static_cast<int>(r.index(9))));
    if (r.index(2)) {
      front.banner(r.uniform(0.5, width - 0.5), 3.3, 4.1, 0.8,
                   b.finish(Pattern::kSign, static_cast<int>(r.index(9))));
    }
    return;
  }
  const int bays = std::max(1, static_cast<int>(width / 2.5));
  const double bay = width / bays;
  const int door = static_cast<int>(r.index(static_cast<uint32_t>(bays)));
  for (int i = 0; i < bays; ++i) {
    const double centre = (i + 0.5) * bay;
    if (i == door) {
      front.patch(centre - 0.55, centre + 0.55, 0.15, 2.35, 0.02,
                  b.finish(Pattern::kDoor, static_cast<int>(r.index(6))));
      front.ledge(centre - 0.8, centre + 0.8, 0, 0.15, 0.5, style.trim);
      front.ledge(centre - 0.75, centre + 0.75, 2.45, 2.6, 0.35, style.trim);
    } else {
      build_window(b, front, style, centre, 0.95);
    }
  }
  front.ledge(0, width, 0, 0.45, 0.06, b.finish(Pattern::kAshlar, 1, Colour(0.8f, 0.8f, 0.8f)));
}

void build_house(Builder& b, const Vector2d& origin, const Vector2d& along, double width) {
  Rng& r = b.random();
  const Style style = random_style(b);
  const int storeys = 2 + static_cast<int>(r.index(3));
  const double height = 0.4 + storeys * style.storey;
  Front front(b, origin, along);
  front.patch(0, width, 0, height, 0, style.wall);
  const Vector2d back = origin - 8.0 * Vector2d(along.y(), -along.x());
  b.wall(origin, back, 0, height, style.wall);
  b.wall(origin + width * along, back + width * along, 0, height, style.wall);
  front.ledge(0, width, height - 0.35, height, 0.35, style.trim);
  build_ground_floor(b, front, style, width);
  const int bays = std::max(1, static_cast<int>(width / 2.3));
  const double bay = width / bays;
  for (int storey = 1; storey < storeys; ++storey) {
    const double floor = 0.35 + storey * style.storey;
    if (storey == 1) front.ledge(0, width, floor - 0.08, floor + 0.1, 0.1, style.trim);
    for (int i = 0; i < bays; ++i) build_window(b, front, style, (i + 0.5) * bay, floor + 0.75);
  }
  const double pipe = r.uniform(0.1, 0.3);
  front.ledge(pipe, pipe + 0.1, 0.2, height - 0.3, 0.12,
              b.finish(Pattern::kPlain, 0, Colour(0.45f, 0.45f, 0.42f)));
}

}  // namespace

void build_facades(Builder& b, const Vector2d& from, const Vector2d& to) {
  const double length = (to - from).norm();
  const Vector2d along = (to - from) / length, out(along.y(), -along.x());
  double at = 0;
  while (length - at > 1.0) {
    double width = b.random().uniform(5.5, 11.0);
    if (length - at - width < 4.0) width = length - at;
    build_house(b, from + at * along + b.random().uniform(-0.5, 0.3) * out, along, width);
    at += width;
    if (b.random().index(6) == 0) at += 1.6;  // an alley
  }
}

}  // namespace raysfm::synth
