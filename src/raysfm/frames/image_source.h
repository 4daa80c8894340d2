#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "raysfm/frames/frame_source.h"

namespace raysfm {

// Frames that are image files, in this order, with strictly increasing timestamps (as many). `what` begins
// the description. The first image that can be decoded is decoded here, so that the size is known at once;
// one that is damaged, of another size or no longer there is a frame with a defect. Errors: bad input, where
// a file is missing or none can be decoded.
Result<std::unique_ptr<FrameSource>> open_images(std::string what, std::vector<std::filesystem::path> files,
                                                 std::vector<double> timestamps);

// Timestamps of `count` images without any: index / fps, or the index where fps is 0.
std::vector<double> index_timestamps(size_t count, double fps);

// "img2" before "img10": runs of digits compare as numbers, everything else as characters.
bool natural_less(std::string_view a, std::string_view b);

// Image files of a folder in natural order: those that begin like an image, and those that only have an
// image's extension, so that a damaged frame is found and not skipped. Hidden files and mask.png are no
// frames. Errors: bad input, for a folder that cannot be listed.
Result<std::vector<std::filesystem::path>> list_images(const std::filesystem::path& folder);

// Files whose names match the last component of `pattern`: *, ? or one printf %d, %4d, %04d, in natural
// order.
Result<std::vector<std::filesystem::path>> match_images(const std::filesystem::path& pattern);

}  // namespace raysfm
