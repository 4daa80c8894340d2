#include "raysfm/synth/scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace raysfm::synth {

namespace {

constexpr int kLeafSurfaces = 3;
constexpr float kMargin = 1e-3f;  // metres; covers the rounding of the box test

void copy(const Eigen::Vector3d& v, float* out) {
  for (int i = 0; i < 3; ++i) out[i] = static_cast<float>(v[i]);
}

}  // namespace

struct Scene::Box {
  Eigen::Array3f low, high;
  Eigen::Array3f centre() const { return 0.5f * (low + high); }
};

Scene::Scene(const World& world, double time, const Eigen::Vector3d& origin) {
  for (const Quad& quad : world.quads) add(quad, world.light, origin);
  for (const Ellipsoid& ellipsoid : world.ellipsoids) add(ellipsoid, origin);
  std::vector<Ellipsoid> people;
  for (const Walker& walker : world.walkers) {
    const Eigen::Vector3d away = walker.place(time) - origin;
    if (Eigen::Vector2d(away.x(), away.z()).norm() > 0.8) walker.pose(time, &people);
  }
  for (const Ellipsoid& part : people) add(part, origin);

  std::vector<Box> boxes;
  boxes.reserve(finishes_.size());
  for (const Quad& q : world.quads) {
    const Eigen::Array3d a = q.corner - origin, b = a + (q.right * q.width).array(),
                         c = a + (q.down * q.height).array(), d = b + c - a;
    boxes.push_back(
        {a.min(b).min(c).min(d).cast<float>() - kMargin, a.max(b).max(c).max(d).cast<float>() + kMargin});
  }
  const auto box_of = [&](const Ellipsoid& e) {
    const Eigen::Array3d reach = (e.axes * e.radii.asDiagonal()).rowwise().norm();
    const Eigen::Array3d centre = e.centre - origin;
    boxes.push_back({(centre - reach).cast<float>() - kMargin, (centre + reach).cast<float>() + kMargin});
  };
  for (const Ellipsoid& e : world.ellipsoids) box_of(e);
  for (const Ellipsoid& e : people) box_of(e);

  order_.resize(boxes.size());
  for (size_t i = 0; i < boxes.size(); ++i) order_[i] = static_cast<int32_t>(i);
  if (!boxes.empty()) build(boxes, 0, static_cast<int>(boxes.size()));
}

void Scene::add(const Quad& quad, const Light& light, const Eigen::Vector3d& origin) {
  const Eigen::Vector3d corner = quad.corner - origin;
  Eigen::Vector3d normal = quad.right.cross(quad.down);
  TracedQuad traced;
  copy(normal, traced.normal);
  copy(quad.right, traced.right);
  copy(quad.down, traced.down);
  traced.offset = static_cast<float>(normal.dot(corner));
  traced.right0 = static_cast<float>(-quad.right.dot(corner));
  traced.down0 = static_cast<float>(-quad.down.dot(corner));
  traced.width = static_cast<float>(quad.width);
  traced.height = static_cast<float>(quad.height);
  quads_.push_back(traced);
  finishes_.push_back(quad.finish);
  if (normal.dot(corner) > 0) normal = -normal;  // the side that the origin sees
  lights_.push_back(light.on(normal.cast<float>()));
}

void Scene::add(const Ellipsoid& ellipsoid, const Eigen::Vector3d& origin) {
  TracedEllipsoid traced;
  const Eigen::Matrix3d to_unit = ellipsoid.radii.cwiseInverse().asDiagonal() * ellipsoid.axes.transpose();
  for (int i = 0; i < 3; ++i) copy(to_unit.row(i), traced.to_unit + 3 * i);
  copy(ellipsoid.centre - origin, traced.centre);
  ellipsoids_.push_back(traced);
  finishes_.push_back(ellipsoid.finish);
}

int Scene::build(std::span<const Box> boxes, int begin, int end) {
  const float huge = std::numeric_limits<float>::max();
  Box all{Eigen::Array3f::Constant(huge), Eigen::Array3f::Constant(-huge)}, centres = all;
  for (int i = begin; i < end; ++i) {
    const Box& box = boxes[static_cast<size_t>(order_[i])];
    all = {all.low.min(box.low), all.high.max(box.high)};
    centres = {centres.low.min(box.centre()), centres.high.max(box.centre())};
  }
  int axis = 0;
  (centres.high - centres.low).maxCoeff(&axis);
  const int number = static_cast<int>(nodes_.size());
  BoxNode node{{all.low.x(), all.low.y(), all.low.z()},
               {all.high.x(), all.high.y(), all.high.z()},
               begin,
               end - begin,
               axis};
  nodes_.push_back(node);
  if (end - begin <= kLeafSurfaces) return number;

  const int middle = (begin + end) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](int32_t a, int32_t b) {
                     const float ca = boxes[static_cast<size_t>(a)].centre()[axis],
                                 cb = boxes[static_cast<size_t>(b)].centre()[axis];
                     return ca != cb ? ca < cb : a < b;
                   });
  build(boxes, begin, middle);
  nodes_[number].first = build(boxes, middle, end);
  nodes_[number].count = 0;
  return number;
}

}  // namespace raysfm::synth
