#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace raysfm {

// Descriptors of 128 numbers each, in two layouts in which many can be compared at once.
class DescriptorTable {
 public:
  static constexpr int kLength = 128;
  static constexpr int kGroup = 16;         // descriptors that are compared at once
  static constexpr int32_t kFar = 1 << 30;  // beyond any squared distance

  static constexpr int kParts = 4096;  // of one, to which numbers are rounded

  // A descriptor of unit length, its numbers not below 0.
  void add(std::span<const float, kLength> descriptor);

  int size() const { return static_cast<int>(norms_.size()); }
  const int16_t* row(int i) const { return rows_.data() + size_t{kLength} * i; }
  int32_t norm(int i) const { return norms_[i]; }  // squared
  int groups() const { return (size() + kGroup - 1) / kGroup; }
  // By pair of numbers, the pair of each descriptor of the group; 0 where there is none.
  const int16_t* group(int g) const { return groups_.data() + size_t{kLength} * kGroup * g; }
  // Number `k` of descriptor `i`.
  int number(int i, int k) const { return row(i)[k]; }

 private:
  std::vector<int16_t> rows_, groups_;
  std::vector<int32_t> norms_;
};

// The descriptor nearest to one, and the squared distances to it and to the next.
struct NearestTwo {
  int index = -1;
  int32_t first = DescriptorTable::kFar, second = DescriptorTable::kFar;
};

// For each descriptor of one table the nearest of the other, and the other way round; the lower index first
// where distances are equal. The same on every instruction set.
void find_nearest_two(const DescriptorTable& a, const DescriptorTable& b, std::vector<NearestTwo>* in_b,
                      std::vector<NearestTwo>* in_a);

}  // namespace raysfm
