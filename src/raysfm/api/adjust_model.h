#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "raysfm/api/adjust.h"

namespace raysfm {

// A point seen in an image; indices into a file.
struct SeenPoint {
  int image = 0;
  int point = 0;
};

// What of a file takes part in its adjustment, and its numbering there: points that two images see, and
// images that see one of them, in the given order.
struct AdjustSelection {
  std::vector<int> images, points;              // index in the file, by index in the adjustment
  std::vector<int> image_number, point_number;  // index in the adjustment, by index in the file; -1: left out

  AdjustSelection(std::span<const SeenPoint> seen, const std::vector<int>& image_order, int point_count);
};

// Where the files of a COLMAP model are: the given folder, or `sparse` or `sparse/0` below it.
std::filesystem::path model_folder(const std::filesystem::path& input);

// Notes in the result that the model is to stay as it was, if its cost has risen.
bool keeps_start(AdjustResult* result);

// Adjusts the file in place and fills counts, summary and errors of the result; the model itself, times and
// interruption are left to the caller. `ready` is called when everything has been found good.
struct AdjustTask {
  BundleMethod method = BundleMethod::kGlobal;
  BundleMethodOptions options;
  std::function<Result<void>()> ready;
};
Result<void> adjust_bal_file(const AdjustTask& task, BalFile* file, AdjustResult* result);
Result<void> adjust_colmap_model(const AdjustTask& task, const std::filesystem::path& folder,
                                 ColmapModel* model, AdjustResult* result);

}  // namespace raysfm
