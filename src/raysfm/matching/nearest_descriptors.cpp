#include "raysfm/matching/nearest_descriptors.h"

#include <algorithm>
#include <array>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/matching/nearest_descriptors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr int kRows = 8;  // of a, at once

#if HWY_TARGET == HWY_SCALAR

// Twice the products of some descriptors and a group.
void group_products(const uint8_t* const* rows, const uint8_t* group, int32_t* out) {
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < DescriptorTable::kGroup; ++c) {
      int32_t sum = 0;
      for (int k = 0; k < DescriptorTable::kLength; ++k) {
        sum += rows[r][k] * group[(k / 4 * DescriptorTable::kGroup + c) * 4 + k % 4];
      }
      out[r * DescriptorTable::kGroup + c] = 2 * sum;
    }
  }
}

#else

// Sums of the products of two neighbours each, numbers of 7 bits: one instruction, which this version of
// Highway has not.
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
HWY_INLINE hn::Vec512<int16_t> sums_of_two(hn::Vec512<uint8_t> a, hn::Vec512<uint8_t> b) {
  return {_mm512_maddubs_epi16(a.raw, b.raw)};
}
#elif HWY_TARGET == HWY_AVX2
HWY_INLINE hn::Vec256<int16_t> sums_of_two(hn::Vec256<uint8_t> a, hn::Vec256<uint8_t> b) {
  return {_mm256_maddubs_epi16(a.raw, b.raw)};
}
#elif HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_SSSE3
HWY_INLINE hn::Vec128<int16_t> sums_of_two(hn::Vec128<uint8_t> a, hn::Vec128<uint8_t> b) {
  return {_mm_maddubs_epi16(a.raw, b.raw)};
}
#else
template <class V>
HWY_INLINE auto sums_of_two(V a, V b) {
  const hn::RepartitionToWide<hn::DFromV<V>> unsigned_d;
  const hn::RebindToSigned<decltype(unsigned_d)> d;
  const auto even = [&](V v) {
    return hn::BitCast(d, hn::And(hn::BitCast(unsigned_d, v), hn::Set(unsigned_d, 255)));
  };
  const auto odd = [&](V v) { return hn::BitCast(d, hn::ShiftRight<8>(hn::BitCast(unsigned_d, v))); };
  return hn::Add(hn::Mul(even(a), even(b)), hn::Mul(odd(a), odd(b)));
}
#endif

// Twice the products of the descriptors of `rows` and those of a part of a group, from lane `first` on. As
// all numbers are positive and the descriptors of unit length, no sum of some of the products is beyond 16
// bits.
template <class D>
void products(D d, const uint8_t* const* rows, const uint8_t* group, size_t first,
              int32_t* HWY_RESTRICT out) {
  const hn::RepartitionToNarrow<D> halves;
  const hn::Repartition<uint8_t, D> fours;
  hn::VFromD<decltype(halves)> sums[kRows];
  for (int r = 0; r < kRows; ++r) sums[r] = hn::Zero(halves);
  const uint8_t* at = group + 4 * first;
  for (int k = 0; k < DescriptorTable::kLength; k += 4, at += 4 * DescriptorTable::kGroup) {
    const auto of_group = hn::LoadU(fours, at);
    for (int r = 0; r < kRows; ++r) {
      int32_t four;
      hwy::CopyBytes<4>(rows[r] + k, &four);
      sums[r] = hn::Add(sums[r], sums_of_two(hn::BitCast(fours, hn::Set(d, four)), of_group));
    }
  }
  for (int r = 0; r < kRows; ++r) {
    auto odd = hn::Zero(d);
    const auto even = hn::ReorderWidenMulAccumulate(d, sums[r], hn::Set(halves, 2), hn::Zero(d), odd);
    hn::StoreU(hn::RearrangeToOddPlusEven(even, odd), d, out + r * DescriptorTable::kGroup + first);
  }
}

// Twice the products of some descriptors and a group.
void group_products(const uint8_t* const* rows, const uint8_t* group, int32_t* HWY_RESTRICT out) {
  const hn::CappedTag<int32_t, DescriptorTable::kGroup> d;
  for (size_t first = 0; first < size_t{DescriptorTable::kGroup}; first += hn::Lanes(d)) {
    products(d, rows, group, first, out);
  }
}

#endif

// Distances of a group from one descriptor; whether any is below its limit or that of the row.
bool any_near(const int32_t* HWY_RESTRICT twice, int32_t norm, const int32_t* HWY_RESTRICT norms,
              const int32_t* HWY_RESTRICT limits, int32_t limit, int32_t* HWY_RESTRICT distances) {
  const hn::CappedTag<int32_t, DescriptorTable::kGroup> d;
  bool any = false;
  for (size_t i = 0; i < size_t{DescriptorTable::kGroup}; i += hn::Lanes(d)) {
    const auto distance =
        hn::Sub(hn::Add(hn::Set(d, norm), hn::LoadU(d, norms + i)), hn::LoadU(d, twice + i));
    hn::StoreU(distance, d, distances + i);
    const auto most = hn::Max(hn::Set(d, limit), hn::LoadU(d, limits + i));
    any |= !hn::AllFalse(d, hn::Lt(distance, most));
  }
  return any;
}

void offer(int index, int32_t distance, NearestTwo* nearest) {
  if (distance < nearest->first) {
    nearest->second = nearest->first;
    nearest->first = distance, nearest->index = index;
  } else if (distance < nearest->second) {
    nearest->second = distance;
  }
}

// What the columns of a group have to be compared with, and where what is found goes.
struct Columns {
  std::array<int32_t, DescriptorTable::kGroup> norms, limits;
  int first, count;
};

void compare_row(const Columns& columns, const int32_t* twice, int row, int32_t norm, NearestTwo* of_row,
                 NearestTwo* of_columns, int32_t* limits) {
  std::array<int32_t, DescriptorTable::kGroup> distances;
  if (!any_near(twice, norm, columns.norms.data(), limits, of_row->second, distances.data())) return;
  for (int c = 0; c < columns.count; ++c) {
    offer(columns.first + c, distances[c], of_row);
    offer(row, distances[c], &of_columns[c]);
    limits[c] = of_columns[c].second;
  }
}

void find_two(const DescriptorTable& a, const DescriptorTable& b, NearestTwo* in_b, NearestTwo* in_a) {
  for (int g = 0; g < b.groups(); ++g) {
    Columns columns{};
    columns.first = DescriptorTable::kGroup * g;
    columns.count = std::min(DescriptorTable::kGroup, b.size() - columns.first);
    columns.norms.fill(DescriptorTable::kFar);
    columns.limits.fill(0);
    for (int c = 0; c < columns.count; ++c) {
      columns.norms[c] = b.norm(columns.first + c);
      columns.limits[c] = in_a[columns.first + c].second;
    }
    std::array<int32_t, kRows * DescriptorTable::kGroup> twice;
    for (int first = 0; first < a.size(); first += kRows) {
      const int count = std::min(kRows, a.size() - first);
      const uint8_t* rows[kRows];
      for (int r = 0; r < kRows; ++r) rows[r] = a.row(first + std::min(r, count - 1));
      group_products(rows, b.group(g), twice.data());
      for (int r = 0; r < count; ++r) {
        compare_row(columns, twice.data() + r * DescriptorTable::kGroup, first + r, a.norm(first + r),
                    &in_b[first + r], in_a + columns.first, columns.limits.data());
      }
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(find_two);

void DescriptorTable::add(std::span<const float, kLength> descriptor) {
  const int i = size(), in_group = i % kGroup;
  if (in_group == 0) groups_.resize(groups_.size() + size_t{kLength} * kGroup, 0);
  uint8_t* group = groups_.data() + size_t{kLength} * kGroup * (i / kGroup);
  int32_t norm = 0;
  for (int k = 0; k < kLength; ++k) {
    const auto number =
        static_cast<uint8_t>(std::min(kMost, std::lround(static_cast<float>(kParts) * descriptor[k])));
    rows_.push_back(number);
    group[(k / 4 * kGroup + in_group) * 4 + k % 4] = number;
    norm += number * number;
  }
  norms_.push_back(norm);
}

void find_nearest_two(const DescriptorTable& a, const DescriptorTable& b, std::vector<NearestTwo>* in_b,
                      std::vector<NearestTwo>* in_a) {
  in_b->assign(a.size(), {});
  in_a->assign(b.size(), {});
  HWY_DYNAMIC_DISPATCH(find_two)(a, b, in_b->data(), in_a->data());
}

}  // namespace raysfm
#endif  // HWY_ONCE
