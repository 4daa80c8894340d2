#include "raysfm/matching/nearest_descriptors.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "raysfm/core/random.h"
#include "support/instruction_sets.h"

namespace raysfm {
namespace {

using Descriptors = Eigen::Matrix<float, Eigen::Dynamic, DescriptorTable::kLength, Eigen::RowMajor>;

// Of unit length, not below 0; every fifth is much like one of `others`, where there are any.
Descriptors descriptors(int count, const Descriptors& others, Rng* rng) {
  Descriptors made(count, DescriptorTable::kLength);
  for (int i = 0; i < count; ++i) {
    for (int k = 0; k < DescriptorTable::kLength; ++k) {
      const bool alike = i % 5 == 0 && others.rows() > 0;
      const float other = alike ? others(i % others.rows(), k) : 0.0F;
      made(i, k) = other + static_cast<float>(std::pow(rng->uniform(), 4)) * (alike ? 0.01F : 1.0F);
    }
    made.row(i).normalize();
  }
  return made;
}

DescriptorTable table_of(const Descriptors& rows) {
  DescriptorTable table;
  for (int i = 0; i < rows.rows(); ++i) {
    table.add(std::span<const float, DescriptorTable::kLength>(rows.row(i).data(), DescriptorTable::kLength));
  }
  return table;
}

int32_t square_distance(const DescriptorTable& a, int i, const DescriptorTable& b, int j) {
  int32_t sum = 0;
  for (int k = 0; k < DescriptorTable::kLength; ++k) {
    const int32_t difference = a.number(i, k) - b.number(j, k);
    sum += difference * difference;
  }
  return sum;
}

NearestTwo by_definition(const DescriptorTable& a, int i, const DescriptorTable& b) {
  NearestTwo nearest;
  for (int j = 0; j < b.size(); ++j) {
    const int32_t d = square_distance(a, i, b, j);
    if (d < nearest.first) {
      nearest = {j, d, nearest.first};
    } else {
      nearest.second = std::min(nearest.second, d);
    }
  }
  return nearest;
}

TEST(NearestDescriptors, AreThoseOfTheDefinitionOnEveryInstructionSet) {
  Rng rng(1);
  for (const auto& [size_a, size_b] : {std::pair(0, 5), {5, 0}, {1, 1}, {3, 17}, {33, 16}, {70, 50}}) {
    const Descriptors rows_a = descriptors(size_a, Descriptors(0, 128), &rng);
    const DescriptorTable a = table_of(rows_a), b = table_of(descriptors(size_b, rows_a, &rng));
    testing_support::for_each_instruction_set([&](const char* name) {
      std::vector<NearestTwo> in_b, in_a;
      find_nearest_two(a, b, &in_b, &in_a);
      ASSERT_EQ(in_b.size(), static_cast<size_t>(size_a));
      ASSERT_EQ(in_a.size(), static_cast<size_t>(size_b));
      const auto expect_equal = [&](const NearestTwo& found, const NearestTwo& expected, int i) {
        EXPECT_EQ(found.index, expected.index) << name << " " << i;
        EXPECT_EQ(found.first, expected.first) << name << " " << i;
        EXPECT_EQ(found.second, expected.second) << name << " " << i;
      };
      for (int i = 0; i < size_a; ++i) expect_equal(in_b[i], by_definition(a, i, b), i);
      for (int j = 0; j < size_b; ++j) expect_equal(in_a[j], by_definition(b, j, a), j);
    });
  }
}

TEST(NearestDescriptors, RoundingHardlyChangesDistances) {
  Rng rng(2);
  Descriptors rows = descriptors(40, Descriptors(0, 128), &rng);
  rows.row(0).setZero();
  rows(0, 7) = rows(0, 60) = std::sqrt(0.5F);                       // all in two numbers
  rows.row(1).setConstant(1 / std::sqrt(static_cast<float>(128)));  // the same in all
  const DescriptorTable table = table_of(rows);
  // Each number of each of two descriptors is off by half a part at most.
  const double most = std::sqrt(DescriptorTable::kLength) / DescriptorTable::kParts;
  double sum = 0;
  for (int i = 0; i < table.size(); ++i) {
    for (int j = 0; j < table.size(); ++j) {
      const double rounded = std::sqrt(square_distance(table, i, table, j)) / DescriptorTable::kParts;
      const double error = std::abs(rounded - (rows.row(i) - rows.row(j)).norm());
      EXPECT_LE(error, most) << i << " " << j;
      sum += error * error;
    }
  }
  EXPECT_LT(std::sqrt(sum / (table.size() * table.size())), 0.005);
}

}  // namespace
}  // namespace raysfm
