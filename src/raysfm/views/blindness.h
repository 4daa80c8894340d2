#pragma once

#include <optional>
#include <string>

#include "raysfm/views/view.h"

namespace raysfm {

// Why nothing can be recognised in a view with its corners: hardly any of them, perhaps because it is dark.
// Nothing where there are enough.
std::optional<std::string> blindness(const View& view);

}  // namespace raysfm
