#pragma once

#include <filesystem>
#include <vector>

#include "batch_list.h"
#include "batch_record.h"
#include "raysfm/core/result.h"

namespace raysfm::app {

// Jobs that can run side by side, and those that join what pieces of long videos became.
struct BatchPlan {
  std::vector<BatchJob> jobs, joins;

  // Of both, in the order of the table.
  std::vector<BatchJob> all() const;
};

// Cuts videos into the pieces that their lines ask for: NAME.piece-1, ... `inputs` is the folder that names
// of inputs are seen from. A video that cannot be opened is cut as it was before, where the records of all
// its pieces say how. Else it is one job with its fault, as is one whose length is not known, or whose pieces
// would be shorter than their overlap. Errors: bad input with the line, where a flag is of whole videos only,
// or two results have one name.
Result<BatchPlan> plan_batch(const std::vector<BatchJob>& lines, const std::filesystem::path& inputs,
                             const BatchFolder& folder);

}  // namespace raysfm::app
