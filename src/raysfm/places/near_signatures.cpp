#include "raysfm/places/near_signatures.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/places/near_signatures.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// From `begin` on, as far as whole vectors go; returns where that is.
template <class D>
size_t collect(D d, uint64_t signature, const uint64_t* HWY_RESTRICT signatures, size_t begin, size_t count,
               int most, uint32_t* HWY_RESTRICT found, size_t* HWY_RESTRICT number) {
  const hn::RebindToSigned<D> counts;
  const auto wanted = hn::Set(d, signature);
  const auto limit = hn::Set(counts, int64_t{most} + 1);
  for (; begin + hn::Lanes(d) <= count; begin += hn::Lanes(d)) {
    const auto apart = hn::PopulationCount(hn::Xor(hn::LoadU(d, signatures + begin), wanted));
    const auto is_near = hn::Lt(hn::BitCast(counts, apart), limit);
    if (HWY_LIKELY(hn::AllFalse(counts, is_near))) continue;
    uint8_t bits[8] = {};
    hn::StoreMaskBits(counts, is_near, bits);
    for (unsigned left = bits[0]; left != 0; left &= left - 1) {
      found[(*number)++] = static_cast<uint32_t>(begin) + hwy::Num0BitsBelowLS1Bit_Nonzero32(left);
    }
  }
  return begin;
}

size_t find_near(uint64_t signature, const uint64_t* signatures, size_t count, int most, uint32_t* found) {
  const hn::CappedTag<uint64_t, 8> d;
  const hn::CappedTag<uint64_t, 1> one;
  size_t number = 0;
  const size_t done = collect(d, signature, signatures, 0, count, most, found, &number);
  collect(one, signature, signatures, done, count, most, found, &number);
  return number;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(find_near);

size_t find_near_signatures(uint64_t signature, const uint64_t* signatures, size_t count, int most,
                            uint32_t* found) {
  return most < 0 ? 0 : HWY_DYNAMIC_DISPATCH(find_near)(signature, signatures, count, most, found);
}

}  // namespace raysfm
#endif  // HWY_ONCE
