#include "raysfm/synth/motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <sstream>

#include "raysfm/core/random.h"
#include "raysfm/synth/curve.h"
#include "raysfm/synth/zoom.h"

namespace raysfm::synth {

namespace {

using Eigen::AngleAxisd;
using Eigen::Vector3d;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kDegree = std::numbers::pi / 180.0;

// Band-limited unrest: sines whose amplitudes fall with their frequency. Standard deviation about `strength`.
class Unrest {
 public:
  Unrest(Rng& rng, double strength, double lowest_hz, double highest_hz) {
    double power = 0;
    for (Wave& w : waves_) {
      w.frequency = lowest_hz * std::pow(highest_hz / lowest_hz, rng.uniform());
      w.amplitude = 1.0 / w.frequency;
      w.phase = rng.uniform(0, kTwoPi);
      power += 0.5 * w.amplitude * w.amplitude;
    }
    for (Wave& w : waves_) w.amplitude *= strength / std::sqrt(power);
  }
  double operator()(double time) const {
    double sum = 0;
    for (const Wave& w : waves_) sum += w.amplitude * std::sin(kTwoPi * w.frequency * time + w.phase);
    return sum;
  }

 private:
  struct Wave {
    double frequency, amplitude, phase;
  };
  std::array<Wave, 6> waves_;
};

struct Unrest3 {
  Unrest x, y, z;
  Unrest3(Rng& rng, const Vector3d& strength, double lowest_hz, double highest_hz)
      : x(rng, strength.x(), lowest_hz, highest_hz),
        y(rng, strength.y(), lowest_hz, highest_hz),
        z(rng, strength.z(), lowest_hz, highest_hz) {}
  Vector3d operator()(double time) const { return {x(time), y(time), z(time)}; }
};

// Camera that looks along z when all angles are zero; yaw turns it to the right, pitch up, roll clockwise.
Eigen::Quaterniond attitude(double yaw, double pitch, double roll) {
  return AngleAxisd(yaw, Vector3d::UnitY()) * AngleAxisd(pitch, Vector3d::UnitX()) *
         AngleAxisd(roll, Vector3d::UnitZ());
}

double yaw_of(const Vector3d& forward) {
  return std::atan2(forward.x(), forward.z());
}

// Along a curve, looking ahead, with the bounce of wheels or feet.
Motion follow(const Curve& curve, double points_per_second, uint64_t seed) {
  Rng rng(seed, 11);
  const Unrest3 bounce(rng, {0.006, 0.010, 0.0}, 0.3, 1.6);
  const Unrest3 sway(rng, Vector3d(0.5, 0.7, 0.5) * kDegree, 0.15, 1.2);  // pitch, yaw, roll
  return [=](double time) {
    const double x = points_per_second * time;
    const Vector3d w = sway(time);
    const Eigen::Quaterniond rotation = attitude(yaw_of(curve.derivative(x)) + w.y(), w.x(), w.z());
    return Rigid3{rotation, curve.position(x) + rotation * bounce(time)};
  };
}

// Carried along a curve by someone who walks: looks where the way leads a step or two on, now and then aside,
// and sways with each step.
Motion walk(const Curve& curve, double points_per_second, double spacing, uint64_t seed) {
  Rng rng(seed, 15);
  const double speed = points_per_second * spacing;     // metres per second
  const double pace = kTwoPi * 1.6 * std::sqrt(speed);  // steps, radians per second
  const double phase = rng.uniform(0, kTwoPi), other = rng.uniform(0, kTwoPi);
  const double ahead = 1.6 / spacing, behind = 0.6 / spacing;         // points on the curve
  const Unrest3 look(rng, Vector3d(3, 9, 1.5) * kDegree, 0.04, 0.2);  // pitch, yaw, roll
  const Unrest3 shake(rng, Vector3d(0.25, 0.25, 0.2) * kDegree, 0.8, 3.0);
  const Unrest3 wander(rng, {0.03, 0.01, 0.03}, 0.05, 0.4);
  return [=](double time) {
    const double x = points_per_second * time, step = pace * time + phase, stride = 0.5 * pace * time + other;
    const Vector3d gait = Vector3d(0.5 * std::sin(step), 0.7 * std::sin(stride), 0.6 * std::cos(stride));
    const Vector3d w = look(time) + shake(time) + gait * kDegree;
    const double yaw = yaw_of(curve.position(x + ahead) - curve.position(x - behind));
    const Vector3d sway(0.012 * std::sin(stride), 0.015 * std::cos(step), 0.008 * std::sin(step));
    const Eigen::Quaterniond body(AngleAxisd(yaw, Vector3d::UnitY()));
    return Rigid3{attitude(yaw + w.y(), w.x(), w.z()), curve.position(x) + body * (sway + wander(time))};
  };
}

// Along a curve while turning far to all sides: every part of the motion comes with rotation.
Motion look(const Curve& curve, double points_per_second, uint64_t seed) {
  Rng rng(seed, 16);
  const Unrest3 turn(rng, Vector3d(9, 40, 9) * kDegree, 0.06, 0.25);  // pitch, yaw, roll
  const Unrest3 wander(rng, {0.06, 0.05, 0.06}, 0.05, 0.4);
  return [=](double time) {
    const double x = points_per_second * time;
    const Vector3d w = turn(time);
    return Rigid3{attitude(yaw_of(curve.derivative(x)) + w.y(), w.x(), w.z()),
                  curve.position(x) + wander(time)};
  };
}

// From 0 to 1, twice continuously differentiable, at rest at both ends and beyond.
double eased(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * x * (10 + x * (6 * x - 15));
}

// Along a curve as someone who films from a tripod between: a quarter of the time on the way, half of it
// turning once on the spot, and on.
Motion pan(const Curve& curve, double points, double duration, uint64_t seed) {
  Rng rng(seed, 17);
  const Unrest3 sway(rng, Vector3d(0.5, 0.7, 0.5) * kDegree, 0.15, 1.2);  // pitch, yaw, roll
  return [=](double time) {
    const double part = time / duration;
    const double x = 0.5 * points * (eased(4 * part) + eased(4 * part - 3));
    const Vector3d w = sway(time);
    const double turn = kTwoPi * eased(2 * part - 0.5);
    return Rigid3{attitude(yaw_of(curve.derivative(x)) + turn + w.y(), w.x(), w.z()), curve.position(x)};
  };
}

// No rotation at all and a constant velocity.
Motion straight(const Stage& stage, double speed) {
  const Vector3d from = stage.straight_from, forward = stage.straight_direction;
  const Eigen::Quaterniond rotation = attitude(yaw_of(forward), 0, 0);
  return [=](double time) { return Rigid3{rotation, from + speed * time * forward}; };
}

Motion handheld(const Stage& stage, uint64_t seed) {
  Rng rng(seed, 12);
  const Unrest3 wander(rng, {0.35, 0.07, 0.25}, 0.05, 0.25);
  const Unrest3 tremble(rng, {0.006, 0.008, 0.006}, 0.6, 2.5);
  const Unrest3 look(rng, Vector3d(4, 14, 2) * kDegree, 0.05, 0.25);
  const Unrest3 shake(rng, Vector3d(0.5, 0.5, 0.4) * kDegree, 0.6, 2.5);
  const Eigen::Quaterniond start(AngleAxisd(stage.eye_yaw_deg * kDegree, Vector3d::UnitY()));
  const Vector3d eye = stage.eye;
  return [=](double time) {
    const Vector3d w = look(time) + shake(time);
    return Rigid3{start * attitude(w.y(), w.x(), w.z()), eye + start * (wander(time) + tremble(time))};
  };
}

// `away`: factor by which the distance to the centre grows, by the law of a zooming lens.
Motion orbit(const Stage& stage, double duration, double away, uint64_t seed) {
  Rng rng(seed, 13);
  const Unrest3 shake(rng, Vector3d(0.4, 0.4, 0.4) * kDegree, 0.2, 1.2);
  const Stage s = stage;
  return [=](double time) {
    const double angle = (s.orbit_start_deg + s.orbit_arc_deg * time / duration) * kDegree;
    const double radius = s.orbit_radius * zoom_factor(away, std::clamp(time / duration, 0.0, 1.0));
    const double lift = s.orbit_height + 0.08 * radius * std::sin(kTwoPi * 2.3 * time / duration);
    const Vector3d out(std::sin(angle), 0, -std::cos(angle));
    const double pitch = -std::atan2(lift, radius);
    const Vector3d w = shake(time);
    return Rigid3{attitude(yaw_of(-out) + w.y(), pitch + w.x(), w.z()),
                  s.centre + radius * out - lift * Vector3d::UnitY()};
  };
}

Motion rotate(const Stage& stage, double duration, uint64_t seed) {
  Rng rng(seed, 14);
  const Unrest3 shake(rng, Vector3d(4, 2, 3) * kDegree, 0.05, 0.5);
  const double start = stage.eye_yaw_deg * kDegree;
  const Vector3d eye = stage.eye;
  return [=](double time) {
    const Vector3d w = shake(time);
    return Rigid3{attitude(start + kTwoPi * time / duration + w.y(), w.x(), w.z()), eye};
  };
}

}  // namespace

const std::vector<MotionInfo>& motion_list() {
  static const std::vector<MotionInfo> motions = {
      {"drive", "along the way of the world, looking ahead"},
      {"walk", "the same on foot: swaying with each step, looking about a little"},
      {"look", "the same, turning far to all sides; gives scale to a rig without common view"},
      {"pan", "the same, with a turn all round on the spot half-way, as from a tripod"},
      {"straight", "a straight line without any rotation; gives no scale to a rig without common view"},
      {"loop", "round a closed circuit, looking ahead; how often, --rounds says"},
      {"handheld", "about one place, like someone who shows a room"},
      {"orbit", "round the centre of the world, looking at it"},
      {"dolly", "the same, going away as the lens zooms in, so that the centre keeps its size"},
      {"rotate", "one turn about the centre of the camera, no translation"},
  };
  return motions;
}

bool has_length(std::string_view motion) {
  return motion == "drive" || motion == "walk" || motion == "look" || motion == "pan" || motion == "straight";
}

Result<Motion> make_motion(const Stage& stage, const Habit& habit, const MotionOptions& options) {
  const std::string& name = options.name.empty() ? habit.motion : options.name;
  const double speed = options.length / options.duration;  // metres per second
  if (name == "drive") return follow(Curve(stage.way, false), speed / stage.spacing, options.seed);
  if (name == "walk")
    return walk(Curve(stage.way, false), speed / stage.spacing, stage.spacing, options.seed);
  if (name == "look") return look(Curve(stage.way, false), speed / stage.spacing, options.seed);
  if (name == "pan") {
    return pan(Curve(stage.way, false), options.length / stage.spacing, options.duration, options.seed);
  }
  if (name == "straight") {
    if (options.length > stage.straight_length) {
      std::ostringstream text;
      text << "length: " << options.length << " m is not allowed, motion straight has room for "
           << stage.straight_length << " m here";
      return bad_input(text.str());
    }
    return straight(stage, speed);
  }
  if (name == "loop") {
    Curve circuit(stage.circuit, true);
    const double rate = options.rounds * circuit.period() / options.duration;
    return follow(circuit, rate, options.seed);
  }
  if (name == "handheld") return handheld(stage, options.seed);
  if (name == "orbit") return orbit(stage, options.duration, 1, options.seed);
  if (name == "dolly") return orbit(stage, options.duration, options.zoom, options.seed);
  if (name == "rotate") return rotate(stage, options.duration, options.seed);
  std::string known;
  for (const MotionInfo& info : motion_list()) known += (known.empty() ? "" : ", ") + std::string(info.name);
  return bad_input("motion: '" + name + "' is unknown; known: " + known);
}

}  // namespace raysfm::synth
