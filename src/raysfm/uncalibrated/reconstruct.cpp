#include "raysfm/uncalibrated/reconstruct.h"

#include <algorithm>
#include <string>
#include <utility>

#include "raysfm/projective/degeneracy.h"
#include "raysfm/uncalibrated/lens_choice.h"
#include "raysfm/uncalibrated/one_lens.h"
#include "raysfm/uncalibrated/photo_solver.h"
#include "raysfm/uncalibrated/solution.h"

namespace raysfm {
namespace {

Result<void> check_options(const SolveOptions& options, int image_count) {
  if (!(options.max_error_px > 0)) return bad_input("max_error_px: must be above 0");
  if (!(options.principal_point_sigma >= 0)) return bad_input("principal_point_sigma: must be 0 or more");
  if (!options.lens_of_image.empty() && std::ssize(options.lens_of_image) != image_count) {
    return bad_input("lens_of_image: " + std::to_string(options.lens_of_image.size()) +
                     ", allowed 0 or one for each image, " + std::to_string(image_count));
  }
  if (options.max_samples < 1) return bad_input("max_samples: must be 1 or more");
  return {};
}

// Images that could take part in a start, and as many as what is known of the lenses asks for.
Result<void> check_amount(const PointTracks& tracks, const LensConstraints& constraints) {
  constexpr int kMinPoints = 8;
  std::vector<int> points(tracks.image_count, 0);
  for (const int image : tracks.image) ++points[image];
  const auto usable =
      std::count_if(points.begin(), points.end(), [](int count) { return count >= kMinPoints; });
  const int needed = std::max(2, min_images(constraints));
  if (usable >= needed) return {};
  return no_reconstruction("images: " + std::to_string(usable) + " with at least " +
                           std::to_string(kMinPoints) + " points, at least " + std::to_string(needed) +
                           " are needed (known of the lenses: " + describe(constraints) + ")");
}

// The end of photos of one lens: adjusted together with its distortion, by the photos that have a pose. What
// is too little for that stays as it is.
void finish_photos(const PointTracks& tracks, const SolveOptions& options,
                   UncalibratedReconstruction* result) {
  constexpr int kRounds = 2;  // in the second with what the distortion kept out
  if (options.errors != ErrorRelation::kWithinImages || !adjusts_one_lens(options, *result)) return;
  for (int round = 0; round < kRounds && !options.stopped(); ++round) {
    if (round > 0 && result->radial.none()) break;
    auto lens = adjust_one_lens_to_the_end(tracks, result->inlier, options, result->scene, result->radial);
    if (!lens) break;
    take_lens(tracks, result->image_posed, options, std::move(*lens), result);
  }
}

// One lens or one for each image. Photos that seem to zoom may have one lens that bends.
Result<UncalibratedReconstruction> choose_and_finish(const PointTracks& tracks, const SolveOptions& options,
                                                     Result<UncalibratedReconstruction> fixed,
                                                     Result<UncalibratedReconstruction> zoom) {
  const std::vector<uint8_t> all(tracks.image_count, 1);
  auto result = choose_lens(tracks, all, fixed, zoom, options.max_error_px, options.errors);
  if (!result) return result;
  if (!result->zooming || !fixed) {
    finish_photos(tracks, options, &*result);
    return result;
  }
  finish_photos(tracks, options, &*fixed);
  if (fixed->radial.none()) return result;
  return choose_lens(tracks, all, std::move(fixed), std::move(zoom), options.max_error_px, options.errors);
}

}  // namespace

LensConstraints constraints_for(const PointTracks& tracks, const SolveOptions& options, bool equal,
                                double noise_px) {
  LensConstraints constraints;
  constraints.equal = equal;
  constraints.principal_point = tracks.centre();
  constraints.principal_point_sigma = options.principal_point_sigma * tracks.image_size.maxCoeff() / noise_px;
  if (equal && options.focal_sigma > 0) {
    constraints.focal = options.focal;
    constraints.focal_sigma = options.focal_sigma / noise_px;
  }
  return constraints;
}

Result<UncalibratedScene> linear_start(const PointTracks& tracks, const SolveOptions& options,
                                       bool equal_lenses) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (auto ok = check_options(options, tracks.image_count); !ok) return ok.error();
  const Units units(tracks);
  const auto start = start_of(tracks, units, options);
  if (!start) return start.error();
  const auto whole = [](const std::vector<uint8_t>& marks) {
    return std::all_of(marks.begin(), marks.end(), [](uint8_t mark) { return mark; });
  };
  if (!whole(start->image_posed) || !whole(start->point_placed)) {
    return no_reconstruction("start: an image or a point was not reached");
  }
  std::vector<UncalibratedScene> scenes = metric_starts(tracks, units, *start, equal_lenses);
  if (scenes.empty()) {
    return no_reconstruction("self-calibration: no absolute quadric is positive, at any focal length");
  }
  return std::move(scenes.front());
}

Result<UncalibratedReconstruction> reconstruct(const PointTracks& tracks, const SolveOptions& options) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (auto ok = check_options(options, tracks.image_count); !ok) return ok.error();
  if (auto ok = check_amount(tracks, constraints_for(tracks, options, options.lens != LensChange::kZoom));
      !ok) {
    return ok.error();
  }
  const Units units(tracks);
  const auto start = start_of(tracks, units, options);
  if (!start) return start.error();
  SolveOptions apart = options;  // lenses are shared when all is there
  apart.lens_of_image.clear();
  PhotoSolver photos(tracks, units, apart);
  const auto solved = [&](bool equal) -> Result<UncalibratedReconstruction> {
    auto solution = options.errors == ErrorRelation::kWithinImages
                        ? photos.solve(start, equal)
                        : best_solution(tracks, *start, units, apart, equal);
    if (!solution) return solution.error();
    UncalibratedReconstruction result = filled(tracks, std::move(*solution));
    result.zooming = !equal;
    result.lens_evidence = "as asked for";
    return result;
  };
  Result<UncalibratedReconstruction> result = solved(options.lens != LensChange::kZoom);
  if (options.lens == LensChange::kAuto) {
    result = choose_and_finish(tracks, options, std::move(result), solved(false));
  } else if (result) {
    finish_photos(tracks, options, &*result);
  }
  if (!result) return result;
  share_lenses(tracks, options, &*result);
  if (options.errors == ErrorRelation::kWithinImages) add_model_error(&*result);
  result->degenerate =
      name_degeneracy(result->scene, result->image_posed, result->point_placed, result->lens_sigma);
  return result;
}

}  // namespace raysfm
