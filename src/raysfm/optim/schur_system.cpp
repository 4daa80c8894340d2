#include "raysfm/optim/schur_system.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

// What the damping is relative to.
double scale_of(double diagonal) {
  return diagonal == 0 ? 1.0 : diagonal;
}

}  // namespace

void SchurSystem::set_structure(int pose_count, std::span<const int> point_begin,
                                std::span<const int> pose_of_slot) {
  pose_count_ = pose_count;
  point_count_ = static_cast<int>(point_begin.size()) - 1;
  point_begin_.assign(point_begin.begin(), point_begin.end());
  pose_of_slot_.assign(pose_of_slot.begin(), pose_of_slot.end());
  if (pose_count > BlockCholesky::kDense) find_pattern();
  reduced_.analyze(pose_count, pattern_begin_, pattern_);
  list_products();
  poses_.resize(pose_count);
  points_.resize(point_count_);
  cross_.resize(kCrossSize * pose_of_slot.size());
  scaled_.resize(kCrossSize * pose_of_slot.size());
  eliminated_.resize(kCrossRows * poses_.size());
  factors_.resize(kFactorSize * (points_.size() + 7));
  right_.resize(6 * poses_.size());
  pose_steps_.resize(6 * poses_.size());
  point_steps_.resize(3 * points_.size());
}

// Which poses see a point in common, pose by pose.
void SchurSystem::find_pattern() {
  point_of_slot_.resize(pose_of_slot_.size());
  slot_begin_.assign(pose_count_ + 1, 0);
  for (int p = 0; p < point_count_; ++p) {
    for (int s = point_begin_[p]; s < point_begin_[p + 1]; ++s) {
      point_of_slot_[s] = p;
      ++slot_begin_[pose_of_slot_[s] + 1];
    }
  }
  for (int i = 0; i < pose_count_; ++i) slot_begin_[i + 1] += slot_begin_[i];
  slots_of_pose_.resize(pose_of_slot_.size());
  marks_.assign(slot_begin_.begin(), slot_begin_.end() - 1);
  for (size_t s = 0; s < pose_of_slot_.size(); ++s)
    slots_of_pose_[marks_[pose_of_slot_[s]]++] = static_cast<int>(s);

  marks_.assign(pose_count_, -1);
  pattern_begin_.assign(1, 0);
  pattern_.clear();
  for (int i = 0; i < pose_count_; ++i) {
    marks_[i] = i;
    for (int k = slot_begin_[i]; k < slot_begin_[i + 1]; ++k) {
      const int p = point_of_slot_[slots_of_pose_[k]];
      for (int s = point_begin_[p]; s < point_begin_[p + 1]; ++s) {
        const int j = pose_of_slot_[s];
        if (marks_[j] == i) continue;
        marks_[j] = i;
        pattern_.push_back(j);
      }
    }
    pattern_begin_.push_back(static_cast<int>(pattern_.size()));
  }
}

void SchurSystem::list_products() {
  listed_pairs_.clear();
  pair_target_.clear();
  const auto add = [&](int row_slot, int column_slot, int target) {
    listed_pairs_.push_back({row_slot, column_slot});
    pair_target_.push_back(target);
  };
  for (int p = 0; p < point_count_; ++p) {
    for (int a = point_begin_[p]; a < point_begin_[p + 1]; ++a) {
      const int position_a = reduced_.position(pose_of_slot_[a]);
      add(a, a, reduced_.diagonal(position_a));
      for (int b = a + 1; b < point_begin_[p + 1]; ++b) {
        const int position_b = reduced_.position(pose_of_slot_[b]);
        if (position_a < position_b) {
          add(b, a, reduced_.find(position_b, position_a));
        } else {
          add(a, b, reduced_.find(position_a, position_b));
        }
      }
    }
  }
  sort_products();
}

// Stable, so that each sum runs over the points in their order.
void SchurSystem::sort_products() {
  pair_begin_.assign(reduced_.block_count() + 1, 0);
  for (int target : pair_target_) ++pair_begin_[target + 1];
  runs_.clear();
  for (size_t target = 0; target < reduced_.block_count(); ++target) {
    pair_begin_[target + 1] += pair_begin_[target];
    if (pair_begin_[target + 1] == pair_begin_[target]) continue;
    runs_.push_back({static_cast<int>(target), pair_begin_[target], pair_begin_[target + 1]});
  }
  pairs_.resize(listed_pairs_.size());
  for (size_t k = 0; k < listed_pairs_.size(); ++k) pairs_[pair_begin_[pair_target_[k]]++] = listed_pairs_[k];
}

void SchurSystem::set_zero() {
  std::fill(poses_.begin(), poses_.end(), PoseBlock{});
  std::fill(points_.begin(), points_.end(), PointBlock{});
  std::fill(cross_.begin(), cross_.end(), 0.0);
}

LmStep SchurSystem::solve(double damping) {
  factorize_points(points_.data(), point_count_, damping, factors_.data());
  std::fill(eliminated_.begin(), eliminated_.end(), 0.0);
  scale_slots(point_count_, point_begin_.data(), pose_of_slot_.data(), factors_.data(), cross_.data(),
              scaled_.data(), eliminated_.data());
  reduce(damping);
  if (!reduced_.factorize()) return {};
  reduced_.solve(right_);
  for (int i = 0; i < pose_count_; ++i) {
    std::copy_n(&right_[6 * static_cast<size_t>(reduced_.position(i))], 6,
                &pose_steps_[6 * static_cast<size_t>(i)]);
  }
  substitute_points();
  const double decrease = predicted_decrease(damping);
  return {std::isfinite(decrease), decrease};
}

void SchurSystem::reduce(double damping) {
  reduced_.set_zero();
  for (int i = 0; i < pose_count_; ++i) {
    const int position = reduced_.position(i);
    double* diagonal = reduced_.block(reduced_.diagonal(position));
    std::copy_n(poses_[i].u, 36, diagonal);
    for (int k = 0; k < 6; ++k) {
      diagonal[7 * k] += damping * scale_of(diagonal[7 * k]);
      right_[6 * static_cast<size_t>(position) + k] =
          eliminated_[kCrossRows * static_cast<size_t>(i) + k] - poses_[i].gradient[k];
    }
  }
  for (const ProductRun& run : runs_) {
    subtract_products(scaled_.data(), &pairs_[run.begin], run.end - run.begin, reduced_.block(run.target));
  }
}

void SchurSystem::substitute_points() {
  for (int p = 0; p < point_count_; ++p) {
    const double* inverse = &factors_[kFactorSize * static_cast<size_t>(p)];
    double y[3] = {inverse[6], inverse[7], inverse[8]};
    for (int s = point_begin_[p]; s < point_begin_[p + 1]; ++s) {
      const double* z = &scaled_[kCrossSize * static_cast<size_t>(s)];
      const double* d = pose_step(pose_of_slot_[s]);
      for (int k = 0; k < 3; ++k) {
        for (int r = 0; r < 6; ++r) y[k] += z[kCrossRows * k + r] * d[r];
      }
    }
    double* step = &point_steps_[3 * static_cast<size_t>(p)];
    step[0] = -(inverse[0] * y[0] + inverse[1] * y[1] + inverse[3] * y[2]);
    step[1] = -(inverse[2] * y[1] + inverse[4] * y[2]);
    step[2] = -(inverse[5] * y[2]);
  }
}

// The quadratic model at the solution d of (H + lambda D) d = -g: 1/2 (lambda d^T D d - g^T d).
double SchurSystem::predicted_decrease(double damping) const {
  double sum = 0;
  for (int i = 0; i < pose_count_; ++i) {
    const double* d = pose_step(i);
    for (int k = 0; k < 6; ++k) {
      sum += d[k] * (damping * scale_of(poses_[i].u[7 * k]) * d[k] - poses_[i].gradient[k]);
    }
  }
  for (int p = 0; p < point_count_; ++p) {
    const double* d = point_step(p);
    const double* v = points_[p].v;
    const double diagonal[3] = {v[0], v[3], v[5]};
    for (int k = 0; k < 3; ++k) {
      sum += d[k] * (damping * scale_of(diagonal[k]) * d[k] - points_[p].gradient[k]);
    }
  }
  return 0.5 * sum;
}

}  // namespace raysfm
