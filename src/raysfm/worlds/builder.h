#pragma once

#include "raysfm/core/random.h"
#include "raysfm/worlds/world.h"

namespace raysfm::synth {

// Words to describe worlds with. Lengths in metres; down is +y, the ground y = 0.
class Builder {
 public:
  Builder(std::string name, uint64_t seed, ThreadPool& pool);

  Rng& random() { return random_; }
  World& world() { return world_; }

  // A way of painting; `variety` jitters the tint, and every call begins elsewhere in the pattern.
  Finish finish(Pattern pattern, int variant, const Colour& tint = Colour::Ones(), float variety = 0.08f);

  void quad(const Eigen::Vector3d& corner, const Eigen::Vector3d& right, const Eigen::Vector3d& down,
            double width, double height, const Finish& finish);

  // Level floor or ceiling over [x0, x1] x [z0, z1] at height y.
  void level(double x0, double x1, double z0, double z1, double y, const Finish& finish);

  // Upright wall over the ground line from a to b (x, z), between heights `low` and `high` above the ground;
  // its texture runs from a to b.
  void wall(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double low, double high,
            const Finish& finish);

  // Box with upright walls: centre of its foot, full sizes along x, y, z, turned by `yaw` radians about the
  // vertical. The bottom is left out.
  void box(const Eigen::Vector3d& foot, const Eigen::Vector3d& size, double yaw, const Finish& sides,
           const Finish& top);

  void ellipsoid(const Eigen::Vector3d& centre, const Eigen::Vector3d& radii, const Finish& finish);

  // Trunk and crown; `size` is the height.
  void tree(const Eigen::Vector3d& foot, double size);
  void lamp_post(const Eigen::Vector3d& foot, double height);
  void walker(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

  World finish_world() { return std::move(world_); }

 private:
  World world_;
  Rng random_;
};

// A row of houses along the ground line from a to b, seen from the right-hand side of that direction.
void build_facades(Builder& b, const Eigen::Vector2d& from, const Eigen::Vector2d& to);

// Each fills stage and habit too. `length`: of `drive`.
World build_street(Builder b, double length);
World build_town(Builder b, double length);
World build_terrace(Builder b, double length);
World build_room(Builder b);
World build_corridor(Builder b, double length);
World build_board(Builder b);

}  // namespace raysfm::synth
