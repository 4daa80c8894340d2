#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/core/result.h"

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

// What an adjustment did.
struct AdjustOutcome {
  int images = 0, points = 0, cameras = 0;       // of the file
  int images_left_out = 0, points_left_out = 0;  // ModelReport says why
  double initial_rms_px = 0, final_rms_px = 0;   // over the observations that take part and project
  bool kept_start = false;
  BundleSummary summary;
};

// Notes that the model is to stay as it was, if its cost has risen.
bool keeps_start(AdjustOutcome* outcome);

// Adjusts the file in place. `ready` is called when everything has been found good.
struct AdjustTask {
  BundleMethod method = BundleMethod::kGlobal;
  BundleMethodOptions options;
  std::function<Result<void>()> ready;
};
Result<void> adjust_bal_file(const AdjustTask& task, BalFile* file, AdjustOutcome* outcome);
Result<void> adjust_colmap_model(const AdjustTask& task, const std::filesystem::path& folder,
                                 ColmapModel* model, AdjustOutcome* outcome);

}  // namespace raysfm
