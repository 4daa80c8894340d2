#include "raysfm/api/corner_aligner.h"

#include <Eigen/LU>
#include <algorithm>

namespace raysfm {
namespace {

constexpr int kColumns = 16, kRows = 12;  // cells; the neighbours of a place are those of 3 x 3 cells
constexpr float kMaxDeformation = 0.5f;
// What holds a deformation near none, as a number of neighbours one cell away.
constexpr float kStiffness = 4;

constexpr PatchAlignmentOptions kAlignment{.max_shift_px = 2.0f, .min_zncc = 0.8f};

// Sums over pairs of places from which the affine map between them follows.
struct Moments {
  float count = 0;
  Eigen::Vector2f base = Eigen::Vector2f::Zero(), target = Eigen::Vector2f::Zero();
  Eigen::Matrix2f base_target = Eigen::Matrix2f::Zero(), target_target = Eigen::Matrix2f::Zero();

  void add(const Eigen::Vector2f& b, const Eigen::Vector2f& t) {
    count += 1;
    base += b, target += t;
    base_target += b * t.transpose(), target_target += t * t.transpose();
  }
  void add(const Moments& m) {
    count += m.count;
    base += m.base, target += m.target;
    base_target += m.base_target, target_target += m.target_target;
  }
  Eigen::Matrix2f base_from_target(float stiffness) const {
    const Eigen::Matrix2f held = stiffness * Eigen::Matrix2f::Identity();
    const Eigen::Matrix2f cross = base_target - base * target.transpose() / count + held;
    const Eigen::Matrix2f square = target_target - target * target.transpose() / count + held;
    const Eigen::Matrix2f map = cross * square.inverse();
    const bool small = (map - Eigen::Matrix2f::Identity()).norm() < kMaxDeformation;
    return small ? map : Eigen::Matrix2f::Identity();
  }
};

struct Cells {
  Eigen::Vector2f size;
  int column(const Eigen::Vector2f& p) const { return std::clamp(int(p.x() / size.x()), 0, kColumns - 1); }
  int row(const Eigen::Vector2f& p) const { return std::clamp(int(p.y() / size.y()), 0, kRows - 1); }
};

}  // namespace

void CornerAligner::deform(const GrayView& base, std::span<const Eigen::Vector2f> in_base,
                           std::span<const Eigen::Vector2f> in_target) {
  const Cells cells{{float(base.width) / kColumns, float(base.height) / kRows}};
  std::vector<Moments> own(kColumns * kRows);
  for (size_t i = 0; i < in_base.size(); ++i) {
    // About the centre of the image, so that the sums keep their digits.
    const Eigen::Vector2f centre(0.5f * float(base.width), 0.5f * float(base.height));
    own[cells.row(in_base[i]) * kColumns + cells.column(in_base[i])].add(in_base[i] - centre,
                                                                         in_target[i] - centre);
  }
  std::vector<Eigen::Matrix2f> maps(kColumns * kRows, Eigen::Matrix2f::Identity());
  const float stiffness = kStiffness * cells.size.squaredNorm();
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kColumns; ++c) {
      Moments sum;
      for (int y = std::max(0, r - 1); y < std::min(kRows, r + 2); ++y) {
        for (int x = std::max(0, c - 1); x < std::min(kColumns, c + 2); ++x) sum.add(own[y * kColumns + x]);
      }
      if (sum.count > 0) maps[r * kColumns + c] = sum.base_from_target(stiffness);
    }
  }
  base_from_target_.clear();
  for (const Eigen::Vector2f& p : in_base) {
    base_from_target_.push_back(maps[cells.row(p) * kColumns + cells.column(p)]);
  }
}

void CornerAligner::align(const GrayView& base, std::span<const Eigen::Vector2f> in_base,
                          const GrayView& target, std::span<const Eigen::Vector2f> in_target,
                          std::vector<PatchAlignment>* out) {
  deform(base, in_base, in_target);
  out->resize(in_base.size());
  PatchAligner(kAlignment).align(base, in_base, base_from_target_, target, in_target, *out);
}

}  // namespace raysfm
