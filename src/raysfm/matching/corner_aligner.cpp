#include "raysfm/matching/corner_aligner.h"

#include <Eigen/LU>
#include <algorithm>

namespace raysfm {
namespace {

constexpr int kAlignerColumns = 16,
              kAlignerRows = 12;  // cells; the neighbours of a place are those of 3 x 3 cells
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
  int column(const Eigen::Vector2f& p) const {
    return std::clamp(int(p.x() / size.x()), 0, kAlignerColumns - 1);
  }
  int row(const Eigen::Vector2f& p) const { return std::clamp(int(p.y() / size.y()), 0, kAlignerRows - 1); }
};

PatchAlignment align_in(int octave, const Octaves& base, const Eigen::Vector2f& in_base,
                        const Eigen::Matrix2f& base_from_target, const Octaves& target,
                        const Eigen::Vector2f& start) {
  const Eigen::Vector2f from = into_octave(in_base, octave), to = into_octave(start, octave);
  PatchAlignment aligned;
  PatchAligner(kAlignment)
      .align(base.at(octave), std::span(&from, 1), std::span(&base_from_target, 1), target.at(octave),
             std::span(&to, 1), std::span(&aligned, 1));
  aligned.pixel = out_of_octave(aligned.pixel, octave);
  return aligned;
}

}  // namespace

void CornerAligner::deform(int width, int height, std::span<const Eigen::Vector2f> in_base,
                           std::span<const Eigen::Vector2f> in_target) {
  const Cells cells{{float(width) / kAlignerColumns, float(height) / kAlignerRows}};
  std::vector<Moments> own(kAlignerColumns * kAlignerRows);
  for (size_t i = 0; i < in_base.size(); ++i) {
    // About the centre of the image, so that the sums keep their digits.
    const Eigen::Vector2f centre(0.5f * float(width), 0.5f * float(height));
    own[cells.row(in_base[i]) * kAlignerColumns + cells.column(in_base[i])].add(in_base[i] - centre,
                                                                                in_target[i] - centre);
  }
  std::vector<Eigen::Matrix2f> maps(kAlignerColumns * kAlignerRows, Eigen::Matrix2f::Identity());
  const float stiffness = kStiffness * cells.size.squaredNorm();
  for (int r = 0; r < kAlignerRows; ++r) {
    for (int c = 0; c < kAlignerColumns; ++c) {
      Moments sum;
      for (int y = std::max(0, r - 1); y < std::min(kAlignerRows, r + 2); ++y) {
        for (int x = std::max(0, c - 1); x < std::min(kAlignerColumns, c + 2); ++x)
          sum.add(own[y * kAlignerColumns + x]);
      }
      if (sum.count > 0) maps[r * kAlignerColumns + c] = sum.base_from_target(stiffness);
    }
  }
  base_from_target_.clear();
  for (const Eigen::Vector2f& p : in_base) {
    base_from_target_.push_back(maps[cells.row(p) * kAlignerColumns + cells.column(p)]);
  }
}

void CornerAligner::align(const Octaves& base, std::span<const Eigen::Vector2f> in_base,
                          const Octaves& target, std::span<const Eigen::Vector2f> in_target,
                          std::span<const uint8_t> octaves, int width, int height,
                          std::vector<PatchAlignment>* out) {
  deform(width, height, in_base, in_target);
  const int finest = std::max(base.first(), target.first());
  out->resize(in_base.size());
  for (size_t i = 0; i < in_base.size(); ++i) {
    PatchAlignment& best = (*out)[i];
    best = {in_target[i], 0, false};
    for (int o = std::max<int>(finest, base.clamp(octaves[i])); o >= finest; --o) {
      const PatchAlignment aligned = align_in(o, base, in_base[i], base_from_target_[i], target, best.pixel);
      if (!aligned.converged) break;
      best = aligned;
    }
  }
}

}  // namespace raysfm
