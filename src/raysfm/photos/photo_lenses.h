#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raysfm/core/events.h"
#include "raysfm/frames/photo_exif.h"
#include "raysfm/results/report_file.h"

namespace raysfm {

// A photo and what its camera wrote into it.
struct TakenPhoto {
  std::string name;
  Eigen::Vector2i size;  // pixels; 0 where it could not be read
  std::optional<PhotoExif> exif;
};

// The lenses that the EXIF of photos names, one for each camera, lens, focal length and size of the picture,
// in the order of the photos; empty where no photo has EXIF. A focal length is to be used (not_used is empty)
// where all photos were taken with one lens, and with nothing cropped or resized since.
std::vector<ExifLens> lenses_by_exif(std::span<const TakenPhoto> photos);

// Of each photo the number of its lens among these, -1 for one without pixels; empty where not all others say
// how they were taken, where that was one lens, or where no two were taken with the same.
std::vector<int> numbers_of_lenses(std::span<const TakenPhoto> photos);

// The one whose focal length is to be used, null without one.
ExifLens* lens_to_use(std::vector<ExifLens>* lenses);

// Why the focal length that was found, pixels, contradicts the one that is said; empty where it does not.
std::string contradiction(const ExifLens& said, double found_px);

// Says a line of each.
void tell_exif(std::span<const ExifLens> lenses, const EventSink& event);

}  // namespace raysfm
