#include "raysfm/geometry/point_alignment.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <utility>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

// Of each point, whether it is about where most are. Points of next to no parallax end up anywhere, a million
// times as far; two of 25,000 were all that a fit of least squares saw.
std::vector<uint8_t> are_near(const std::vector<Eigen::Vector3d>& points) {
  constexpr double kFar = 10.0;  // of the median distance; 3 to 1000 tried, none did worse
  Eigen::Vector3d middle;
  std::vector<double> values(points.size());
  for (int c = 0; c < 3; ++c) {
    for (size_t i = 0; i < points.size(); ++i) values[i] = points[i][c];
    middle[c] = median_of(&values);
  }
  for (size_t i = 0; i < points.size(); ++i) values[i] = (points[i] - middle).norm();
  std::vector<double> reordered = values;
  const double most = kFar * median_of(&reordered);
  std::vector<uint8_t> near(points.size());
  for (size_t i = 0; i < points.size(); ++i) near[i] = values[i] <= most;
  return near;
}

// Keeps the pairs for which keep(index) holds.
template <typename Keep>
void keep_pairs(Keep keep, std::vector<Eigen::Vector3d>* a, std::vector<Eigen::Vector3d>* b) {
  size_t kept = 0;
  for (size_t i = 0; i < a->size(); ++i) {
    if (!keep(i)) continue;
    (*a)[kept] = (*a)[i], (*b)[kept] = (*b)[i], ++kept;
  }
  a->resize(kept), b->resize(kept);
}

}  // namespace

Similarity3 align_points(std::vector<Eigen::Vector3d> a, std::vector<Eigen::Vector3d> b, bool with_scale) {
  constexpr int kRounds = 4;
  constexpr double kMostOfMedian = 4.0;
  const std::vector<uint8_t> near_in_a = are_near(a), near_in_b = are_near(b);
  keep_pairs([&](size_t i) { return near_in_a[i] && near_in_b[i]; }, &a, &b);
  Similarity3 b_from_a;
  for (int round = 0; round < kRounds && a.size() >= 3; ++round) {
    using Points = Eigen::Map<const Eigen::Matrix3Xd>;
    const Eigen::Matrix4d m =
        Eigen::umeyama(Points(a[0].data(), 3, a.size()), Points(b[0].data(), 3, b.size()), with_scale);
    const double scale = std::cbrt(m.topLeftCorner<3, 3>().determinant());
    if (!m.allFinite() || !(scale > 0)) break;
    b_from_a = {scale, Eigen::Quaterniond(Eigen::Matrix3d(m.topLeftCorner<3, 3>() / scale)).normalized(),
                m.topRightCorner<3, 1>()};
    std::vector<double> errors(a.size());
    for (size_t i = 0; i < a.size(); ++i) errors[i] = (b_from_a * a[i] - b[i]).norm();
    std::vector<double> reordered = errors;
    const double most = kMostOfMedian * median_of(&reordered);
    keep_pairs([&](size_t i) { return errors[i] <= most; }, &a, &b);
    if (a.size() == errors.size()) break;
  }
  return b_from_a;
}

}  // namespace raysfm
