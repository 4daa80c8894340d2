#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace raysfm {

// What a camera wrote into a photo about how it was taken (Exif 2.32). Empty or 0: not said.
struct PhotoExif {
  std::string camera = {}, lens = {};  // maker and model, printable ASCII
  double focal_mm = 0;
  double focal_35mm = 0;      // of the focal length that shows as much on a film of 36 x 24 mm
  double pixels_per_mm = 0;   // of the sensor, along x
  int width = 0, height = 0;  // of the picture when it was taken, pixels
};

// Of a JPEG or PNG file; nothing where it has no such data, or none that can be read.
std::optional<PhotoExif> read_exif(const std::filesystem::path& path);

// The focal length of a picture of this size, by what its camera wrote.
struct ExifFocal {
  double px = 0;       // 0: not told
  double sigma = 0;    // standard deviation, part of the focal length
  std::string source;  // what it was worked out from
  std::string defect;  // why it is not used, although there is one
};

// Not told, with the reason, for a picture that is not of the size that it was taken with, and for what
// contradicts itself or cannot be.
ExifFocal focal_of_exif(const PhotoExif& exif, int width, int height);

}  // namespace raysfm
