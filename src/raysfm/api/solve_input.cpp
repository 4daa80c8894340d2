#include "raysfm/api/solve_input.h"

#include <fmt/format.h>

#include <cmath>

#include "raysfm/io/text_file.h"
#include "raysfm/io/tracks_file.h"

namespace raysfm {
namespace {

constexpr int64_t kMaxSide = 100000;  // pixels

Result<Eigen::Vector2d> parse_size(const std::string& text) {
  const size_t cross = text.find('x');
  if (cross != std::string::npos) {
    const auto width = parse_integer(std::string_view(text).substr(0, cross));
    const auto height = parse_integer(std::string_view(text).substr(cross + 1));
    const auto good = [](const auto& side) { return side && *side > 0 && *side <= kMaxSide; };
    if (good(width) && good(height)) return Eigen::Vector2d(double(*width), double(*height));
  }
  return bad_input(fmt::format("--size = '{}': must be WIDTHxHEIGHT, two whole numbers from 1 to {}",
                               shown(text), kMaxSide));
}

// Corners come as near to the left and the upper border as to the others.
Eigen::Vector2d guess_size(const std::vector<Eigen::Vector2d>& pixels) {
  Eigen::Vector2d low = pixels[0], high = pixels[0];
  for (const Eigen::Vector2d& p : pixels) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return (high + low.cwiseMax(0)).array().ceil() + 1;
}

}  // namespace

Result<SolveInput> tracks_from_file(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Eigen::Vector2d size = Eigen::Vector2d::Zero();
  if (!settings.size.empty()) {
    const Result<Eigen::Vector2d> given = parse_size(settings.size);
    if (!given) return given.error();
    size = *given;
  }
  Result<TracksFile> file = read_tracks_file(settings.input);
  if (!file) return file.error();
  if (file->pixel.empty()) {
    return bad_input(fmt::format("{}: no observations, only a header line", settings.input));
  }
  if (settings.size.empty()) {
    size = guess_size(file->pixel);
    if (!(size.minCoeff() >= 1)) {
      return bad_input(fmt::format("{}: the pixels do not tell the size of the images; give it with --size",
                                   settings.input));
    }
    if (callbacks.event) {
      callbacks.event(
          {Event::Level::kWarning,
           fmt::format("the images are taken to be {}x{}, as the tracks suggest; --size says it for sure",
                       size.x(), size.y())});
    }
  }
  SolveInput input;
  input.tracks = {.image_count = static_cast<int>(file->images.size()),
                  .point_count = static_cast<int>(file->points.size()),
                  .image_size = size,
                  .image = std::move(file->image),
                  .point = std::move(file->point),
                  .pixel = std::move(file->pixel)};
  input.timestamps = std::move(file->timestamps);
  input.names = std::move(file->images);
  input.keyframe.assign(input.names.size(), 1);
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  return input;
}

}  // namespace raysfm
