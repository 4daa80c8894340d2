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

  // Of one, to which numbers are rounded: the products of two descriptors then take no more than 16 bits.
  // Numbers take 7: from 0.73 on they are the same, while the roots of SIFT's stay below 0.4.
  static constexpr int kParts = 175;
  static constexpr long kMost = 127;

  // A descriptor of unit length, its numbers not below 0.
  void add(std::span<const float, kLength> descriptor);

  int size() const { return static_cast<int>(norms_.size()); }
  const uint8_t* row(int i) const { return rows_.data() + size_t{kLength} * i; }
  int32_t norm(int i) const { return norms_[i]; }  // squared
  int groups() const { return (size() + kGroup - 1) / kGroup; }
  // By four numbers, the four of each descriptor of the group; 0 where there is none.
  const uint8_t* group(int g) const { return groups_.data() + size_t{kLength} * kGroup * g; }
  // Number `k` of descriptor `i`.
  int number(int i, int k) const { return row(i)[k]; }

 private:
  std::vector<uint8_t> rows_, groups_;
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
