#include "raysfm/optim/schur_system.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

constexpr int kPointChunk = 512;       // points, a multiple of the eight that are factorised together
constexpr int kPairsPerChunk = 20000;  // pairs of places

// What the damping is relative to.
double scale_of(double diagonal) {
  return diagonal == 0 ? 1.0 : diagonal;
}

}  // namespace

template <int N>
void SchurSystem<N>::set_structure(int pose_count, std::span<const int> point_begin,
                                   std::span<const int> pose_of_slot) {
  pose_count_ = pose_count;
  point_count_ = static_cast<int>(point_begin.size()) - 1;
  point_begin_.assign(point_begin.begin(), point_begin.end());
  pose_of_slot_.assign(pose_of_slot.begin(), pose_of_slot.end());
  list_slots_of_poses();
  if (pose_count > BlockCholesky::kDense) find_pattern();
  reduced_.analyze(pose_count, pattern_begin_, pattern_);
  list_products();
  cut_work();
  poses_.resize(pose_count);
  points_.resize(point_count_);
  set_size(cross_, kCrossSize<N> * pose_of_slot.size() + kCrossBeyond);
  set_size(factors_, kFactorSize * (points_.size() + 7));
  set_size(right_, N * poses_.size());
  set_size(work_, N * poses_.size());
  set_size(pose_steps_, N * poses_.size());
  set_size(point_steps_, 3 * points_.size());
}

template <int N>
void SchurSystem<N>::list_slots_of_poses() {
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
  points_of_pose_.resize(pose_of_slot_.size());
  place_of_slot_.resize(pose_of_slot_.size());
  marks_.assign(slot_begin_.begin(), slot_begin_.end() - 1);
  for (size_t s = 0; s < pose_of_slot_.size(); ++s) {
    const int place = marks_[pose_of_slot_[s]]++;
    slots_of_pose_[place] = static_cast<int>(s);
    place_of_slot_[s] = place;
    points_of_pose_[place] = point_of_slot_[s];
  }
}

template <int N>
std::span<const int> SchurSystem<N>::slots_of_pose(int i) const {
  return std::span(slots_of_pose_).subspan(slot_begin_[i], slot_begin_[i + 1] - slot_begin_[i]);
}

// Which poses see a point in common, pose by pose.
template <int N>
void SchurSystem<N>::find_pattern() {
  marks_.assign(pose_count_, -1);
  pattern_begin_.assign(1, 0);
  pattern_.clear();
  for (int i = 0; i < pose_count_; ++i) {
    marks_[i] = i;
    for (int k = slot_begin_[i]; k < slot_begin_[i + 1]; ++k) {
      const int p = points_of_pose_[k];
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

// use(position of the row, pair) for the products in the column of a pose, by ascending point.
template <int N>
template <typename Use>
void SchurSystem<N>::for_each_pair(int pose, Use use) const {
  const int column = reduced_.position(pose);
  for (int k = slot_begin_[pose]; k < slot_begin_[pose + 1]; ++k) {
    const int p = points_of_pose_[k];
    for (int s = point_begin_[p]; s < point_begin_[p + 1]; ++s) {
      const int row = reduced_.position(pose_of_slot_[s]);
      if (row >= column) use(row, PlacePair{place_of_slot_[s], k});
    }
  }
}

// Block by block, so that each sum runs over the points in their order and stays in registers.
template <int N>
void SchurSystem<N>::list_products() {
  runs_.clear();
  size_t count = 0;
  for (int p = 0; p < point_count_; ++p) {
    const size_t length = point_begin_[p + 1] - point_begin_[p];
    count += length * (length + 1) / 2;
  }
  set_size(pairs_, count);
  marks_.assign(pose_count_, 0);  // pairs of each row in the column
  place_.resize(pose_count_);
  offsets_.resize(pose_count_);
  pattern_.clear();  // rows of the column that have pairs
  int64_t end = 0;
  for (int pose = 0; pose < pose_count_; ++pose) {
    const int column = reduced_.position(pose);
    reduced_.column_offsets(column, offsets_);
    for_each_pair(pose, [&](int row, PlacePair) {
      if (marks_[row]++ == 0) pattern_.push_back(row);
    });
    const size_t stride = reduced_.stride(column);
    for (int row : pattern_) {
      place_[row] = end;
      runs_.push_back({offsets_[row], stride, end, end + marks_[row]});
      end += marks_[row];
      marks_[row] = 0;
    }
    for_each_pair(pose, [&](int row, PlacePair pair) { pairs_[place_[row]++] = pair; });
    pattern_.clear();
  }
}

template <int N>
void SchurSystem<N>::cut_work() {
  run_chunks_.assign(1, 0);
  int64_t begin = 0;
  for (size_t k = 0; k < runs_.size(); ++k) {
    if (runs_[k].end - begin < kPairsPerChunk) continue;
    run_chunks_.push_back(static_cast<int>(k) + 1);
    begin = runs_[k].end;
  }
  if (run_chunks_.back() != static_cast<int>(runs_.size())) {
    run_chunks_.push_back(static_cast<int>(runs_.size()));
  }
}

template <int N>
void SchurSystem<N>::set_zero() {
  std::fill(poses_.begin(), poses_.end(), PoseBlock{});
  std::fill(points_.begin(), points_.end(), PointBlock{});
  std::fill(cross_.begin(), cross_.end(), 0.0);
}

template <int N>
LmStep SchurSystem<N>::solve(double damping, WorkTeam& team) {
  eliminate_points(damping, team);
  reduce(damping, team);
  if (!reduced_.factorize(team)) return {};
  return substitute(damping, team);
}

template <int N>
LmStep SchurSystem<N>::solve_again(double damping, WorkTeam& team) {
  for (int p = 0; p < point_count_; ++p)
    std::fill_n(&factors_[kFactorSize * static_cast<size_t>(p) + 6], 3, 0.0);
  for (int i = 0; i < pose_count_; ++i) set_right_side(i);
  return substitute(damping, team);
}

// After factorize(): all unknowns from the right hand side.
template <int N>
LmStep SchurSystem<N>::substitute(double damping, WorkTeam& team) {
  reduced_.solve(right_, work_);
  for (int i = 0; i < pose_count_; ++i) {
    std::copy_n(&right_[N * static_cast<size_t>(reduced_.position(i))], N,
                &pose_steps_[N * static_cast<size_t>(i)]);
  }
  team.run((point_count_ + kPointChunk - 1) / kPointChunk, [&](int chunk) {
    const int begin = chunk * kPointChunk;
    substitute_points(begin, std::min(point_count_, begin + kPointChunk));
  });
  const double decrease = predicted_decrease(damping);
  return {std::isfinite(decrease), decrease};
}

template <int N>
void SchurSystem<N>::eliminate_points(double damping, WorkTeam& team) {
  team.run((point_count_ + kPointChunk - 1) / kPointChunk, [&](int chunk) {
    const int begin = chunk * kPointChunk, end = std::min(point_count_, begin + kPointChunk);
    double* factors = &factors_[kFactorSize * static_cast<size_t>(begin)];
    // The last of eight points of a chunk are its own: kPointChunk is a multiple of eight.
    factorize_points(&points_[begin], end - begin, damping, factors);
    scale_slots<N>(begin, end, point_begin_.data(), place_of_slot_.data(), factors_.data(), cross_.data());
  });
}

template <int N>
void SchurSystem<N>::reduce(double damping, WorkTeam& team) {
  reduced_.set_zero();
  const bool share = run_chunks_.size() > 2;
  const auto set_pose = [&](int i) {
    const int position = reduced_.position(i);
    double* diagonal = reduced_.values() + reduced_.offset(position, position);
    const size_t stride = reduced_.stride(position);
    for (int c = 0; c < N; ++c) {
      for (int r = c; r < N; ++r) diagonal[stride * c + r] = poses_[i].u[N * c + r];
      diagonal[stride * c + c] += damping * scale_of(poses_[i].u[N * c + c]);
    }
    set_right_side(i);
  };
  const auto subtract = [&](int chunk) {
    for (int k = run_chunks_[chunk]; k < run_chunks_[chunk + 1]; ++k) {
      const ProductRun& run = runs_[k];
      subtract_products<N>(cross_.data(), &pairs_[run.begin], static_cast<int>(run.end - run.begin),
                           reduced_.values() + run.target, run.stride);
    }
  };
  const int chunks = static_cast<int>(run_chunks_.size()) - 1;
  if (share) {
    team.run(pose_count_, set_pose);
    team.run(chunks, subtract);
  } else {
    for (int i = 0; i < pose_count_; ++i) set_pose(i);
    for (int chunk = 0; chunk < chunks; ++chunk) subtract(chunk);
  }
}

template <int N>
void SchurSystem<N>::set_right_side(int i) {
  double* right = &right_[N * static_cast<size_t>(reduced_.position(i))];
  for (int c = 0; c < N; ++c) right[c] = -poses_[i].gradient[c];
  const int begin = slot_begin_[i];
  add_right_side<N>(&cross_[kCrossSize<N> * static_cast<size_t>(begin)], factors_.data(),
                    points_of_pose_.data() + begin, slot_begin_[i + 1] - begin, right);
}

template <int N>
void SchurSystem<N>::substitute_points(int begin, int end) {
  for (int p = begin; p < end; ++p) {
    const double* inverse = point_factor(p);
    double y[3] = {inverse[6], inverse[7], inverse[8]};
    for (int s = point_begin_[p]; s < point_begin_[p + 1]; ++s) {
      const double* z = cross(s);
      const double* d = pose_step(pose_of_slot_[s]);
      for (int k = 0; k < 3; ++k) {
        double sum = 0;
        for (int r = 0; r < N; ++r) sum += z[cross_place<N>(r, k)] * d[r];
        y[k] += sum;
      }
    }
    double* step = &point_steps_[3 * static_cast<size_t>(p)];
    step[0] = -(inverse[0] * y[0] + inverse[1] * y[1] + inverse[3] * y[2]);
    step[1] = -(inverse[2] * y[1] + inverse[4] * y[2]);
    step[2] = -(inverse[5] * y[2]);
  }
}

// The quadratic model at the solution d of (H + lambda D) d = -g: 1/2 (lambda d^T D d - g^T d).
template <int N>
double SchurSystem<N>::predicted_decrease(double damping) const {
  double sum = 0;
  for (int i = 0; i < pose_count_; ++i) {
    const double* d = pose_step(i);
    for (int k = 0; k < N; ++k) {
      sum += d[k] * (damping * scale_of(poses_[i].u[(N + 1) * k]) * d[k] - poses_[i].gradient[k]);
    }
  }
  for (int p = 0; p < point_count_; ++p) {
    const double* d = point_step(p);
    const double* v = points_[p].v;
    const double diagonal[3] = {v[0], v[3], v[5]};
    double part = 0;
    for (int k = 0; k < 3; ++k) {
      part += d[k] * (damping * scale_of(diagonal[k]) * d[k] - points_[p].gradient[k]);
    }
    sum += part;
  }
  return 0.5 * sum;
}

template <int N>
double SchurSystem<N>::decrease_of_point(int p) const {
  const double* y = point_factor(p) + 6;
  return 0.5 * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
}

template <int N>
void SchurSystem<N>::solve_reduced(std::span<double> b) {
  for (int i = 0; i < pose_count_; ++i) {
    std::copy_n(&b[N * static_cast<size_t>(i)], N, &right_[N * static_cast<size_t>(reduced_.position(i))]);
  }
  reduced_.solve(right_, work_);
  for (int i = 0; i < pose_count_; ++i) {
    std::copy_n(&right_[N * static_cast<size_t>(reduced_.position(i))], N, &b[N * static_cast<size_t>(i)]);
  }
}

template class SchurSystem<6>;
template class SchurSystem<9>;

}  // namespace raysfm
