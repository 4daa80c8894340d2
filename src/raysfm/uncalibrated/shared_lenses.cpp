// share_lenses() of lens_choice.h.
#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "raysfm/uncalibrated/lens_choice.h"
#include "raysfm/uncalibrated/solution.h"

namespace raysfm {
namespace {

// Lenses of the images that have a pose.
int count_lenses(const SolveOptions& options, const UncalibratedReconstruction& result) {
  std::set<int> lenses;
  for (size_t j = 0; j < result.image_posed.size(); ++j) {
    if (result.image_posed[j]) lenses.insert(options.lens_of_image[j]);
  }
  return static_cast<int>(lenses.size());
}

Solution solution_of(const UncalibratedReconstruction& result) {
  Solution solution;
  solution.scene = result.scene;
  solution.image_posed = result.image_posed;
  solution.point_placed = result.point_placed;
  std::copy_n(result.start_images, 2, solution.start_images);
  solution.start_inliers = result.start_inliers;
  return solution;
}

}  // namespace

void share_lenses(const PointTracks& tracks, const SolveOptions& options,
                  UncalibratedReconstruction* result) {
  if (!result->zooming || options.lens_of_image.empty() || !result->radial.none() || options.stopped())
    return;
  const int lenses = count_lenses(options, *result);
  if (lenses >= result->posed_count()) return;
  Solution solution = solution_of(*result);
  if (!settle(tracks, options, false, &solution)) return;
  UncalibratedReconstruction shared = filled(tracks, std::move(solution));
  shared.stages = result->stages;
  const std::vector<uint8_t> all(tracks.image_count, 1);
  const std::string evidence = result->lens_evidence;
  const double rms_of_each = result->rms_px, gain = result->lens_gain, spread = result->lens_spread;
  auto chosen = choose_lens(tracks, all, std::move(shared), std::move(*result), options.max_error_px,
                            ErrorRelation::kWithinImages);
  *result = *std::move(chosen);  // one of two
  const bool is_shared = !result->zooming;
  result->zooming = true;
  result->lens_gain = gain, result->lens_spread = spread;
  result->lens_evidence =
      is_shared
          ? fmt::format(
                "{}; images that are said to share one of {} lenses do: rms {:.3f} px, {:.3f} px with a lens "
                "for each",
                evidence, lenses, result->rms_px, rms_of_each)
          : fmt::format("{}; images that are said to share one of {} lenses do not: {}", evidence, lenses,
                        result->lens_evidence);
}

}  // namespace raysfm
