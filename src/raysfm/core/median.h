#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace raysfm {

// The middle one of `values` in order, the upper of the two where their number is even; 0 where there are
// none. Leaves `values` in another order.
template <typename Number>
Number median_of(std::vector<Number>* values) {
  if (values->empty()) return 0;
  const auto middle = values->begin() + static_cast<ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace raysfm
