#include "raysfm/synth/motion.h"

#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "raysfm/core/random.h"
#include "raysfm/synth/curve.h"

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

Motion orbit(const Stage& stage, double duration, uint64_t seed) {
  Rng rng(seed, 13);
  const Unrest3 shake(rng, Vector3d(0.4, 0.4, 0.4) * kDegree, 0.2, 1.2);
  const Stage s = stage;
  return [=](double time) {
    const double angle = (s.orbit_start_deg + s.orbit_arc_deg * time / duration) * kDegree;
    const double lift = s.orbit_height + 0.08 * s.orbit_radius * std::sin(kTwoPi * 2.3 * time / duration);
    const Vector3d out(std::sin(angle), 0, -std::cos(angle));
    const double pitch = -std::atan2(lift, s.orbit_radius);
    const Vector3d w = shake(time);
    return Rigid3{attitude(yaw_of(-out) + w.y(), pitch + w.x(), w.z()),
                  s.centre + s.orbit_radius * out - lift * Vector3d::UnitY()};
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
      {"loop", "once round a closed circuit, looking ahead"},
      {"handheld", "about one place, like someone who shows a room"},
      {"orbit", "round the centre of the world, looking at it"},
      {"rotate", "one turn about the centre of the camera, no translation"},
  };
  return motions;
}

Result<Motion> make_motion(const Stage& stage, const Habit& habit, const MotionOptions& options) {
  const std::string& name = options.name.empty() ? habit.motion : options.name;
  if (name == "drive") {
    return follow(Curve(stage.way, false), options.length / stage.spacing / options.duration, options.seed);
  }
  if (name == "loop") {
    Curve circuit(stage.circuit, true);
    const double rate = circuit.period() / options.duration;
    return follow(circuit, rate, options.seed);
  }
  if (name == "handheld") return handheld(stage, options.seed);
  if (name == "orbit") return orbit(stage, options.duration, options.seed);
  if (name == "rotate") return rotate(stage, options.duration, options.seed);
  std::string known;
  for (const MotionInfo& info : motion_list()) known += (known.empty() ? "" : ", ") + std::string(info.name);
  return bad_input("motion: '" + name + "' is unknown; known: " + known);
}

}  // namespace raysfm::synth
