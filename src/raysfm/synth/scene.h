#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/worlds/world.h"

namespace raysfm::synth {

// One row of rays relative to the scene's origin, in the world's axes; flat arrays of `count` numbers, a
// multiple of kRayPack. A ray of direction zero sees nothing.
constexpr int kRayPack = 16;
struct RayRow {
  int count = 0;
  const float *sx, *sy, *sz;  // start, metres
  const float *dx, *dy, *dz;  // direction, unit
};

// A surface as the intersection needs it, relative to the origin of the scene.
struct TracedQuad {
  float normal[3], offset;        // normal . x = offset on the plane
  float right[3], right0, width;  // right . x + right0 in [0, width]
  float down[3], down0, height;
};
struct TracedEllipsoid {
  float to_unit[9], centre[3];  // to_unit * (x - centre) lies on the unit sphere; rows
};

// A node of the tree of boxes that rays are tested against.
struct BoxNode {
  float low[3], high[3];
  int32_t
      first;  // leaf: its first surface in `order`; else: its second child (the first one follows the node)
  int32_t count;  // surfaces of a leaf; 0: not a leaf
  int32_t axis;   // along which the children were split
};

// All that is there at one instant, relative to one point, with a hierarchy of boxes over it.
class Scene {
 public:
  // `origin`: world coordinates of the point that rays start near; single precision then suffices at any
  // distance from the origin of the world. People nearer than 0.8 m to it are left out.
  Scene(const World& world, double time, const Eigen::Vector3d& origin);

  // For each ray the distance to the nearest surface, metres, and its number: quads first, then ellipsoids;
  // -1 where there is none.
  void trace(const RayRow& rays, float* distance, int32_t* surface) const;

  std::span<const TracedQuad> quads() const { return quads_; }
  std::span<const TracedEllipsoid> ellipsoids() const { return ellipsoids_; }
  const Finish& finish(int surface) const { return finishes_[static_cast<size_t>(surface)]; }
  // Share of the full light that falls on a quad's visible side.
  float light(int quad) const { return lights_[static_cast<size_t>(quad)]; }

  // What the intersection walks through.
  std::span<const BoxNode> nodes() const { return nodes_; }
  std::span<const int32_t> order() const { return order_; }

 private:
  struct Box;
  void add(const Quad& quad, const Light& light, const Eigen::Vector3d& origin);
  void add(const Ellipsoid& ellipsoid, const Eigen::Vector3d& origin);
  int build(std::span<const Box> boxes, int begin, int end);

  std::vector<TracedQuad> quads_;
  std::vector<TracedEllipsoid> ellipsoids_;
  std::vector<Finish> finishes_;
  std::vector<float> lights_;
  std::vector<BoxNode> nodes_;
  std::vector<int32_t> order_;
};

}  // namespace raysfm::synth
