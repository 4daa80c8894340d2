#include "raysfm/solving/solve_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <unordered_map>

#include "raysfm/files/text_file.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/results/tracks_file.h"

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

// Tracks of undistorted images may leave the picture, but not most of them.
Result<void> check_size(const SolveSettings& settings, const Eigen::Vector2d& size,
                        const std::vector<Eigen::Vector2d>& pixels) {
  const auto outside = std::ranges::count_if(pixels, [&](const Eigen::Vector2d& pixel) {
    return !(pixel.array() > -1).all() || !(pixel.array() < size.array()).all();
  });
  if (2 * outside <= std::ssize(pixels)) return {};
  return bad_input(fmt::format("--size = '{}': {} of {} pixels of {} lie outside", settings.size, outside,
                               pixels.size(), settings.input));
}

// Many images, each of which shares enough points with the one before to go on from it.
bool is_in_order(const PointTracks& tracks) {
  constexpr int kFew = 40, kMinShared = 8;
  if (tracks.image_count <= kFew) return false;
  const std::vector<int> shared = shared_with_previous(tracks);
  return *std::min_element(shared.begin() + 1, shared.end()) >= kMinShared;
}

// Keeps the observations of points that the file knows, with their positions.
Result<void> keep_known(const SolveSettings& settings, const std::vector<std::string>& points,
                        const EventSink& event, SolveInput* input) {
  const Result<StructureFile> known = read_structure_file(settings.structure);
  if (!known) return known.error();
  std::unordered_map<std::string_view, size_t> place;
  for (size_t i = 0; i < known->points.size(); ++i) place.emplace(known->points[i], i);
  std::vector<int> number(points.size(), -1);
  for (size_t i = 0; i < points.size(); ++i) {
    const auto found = place.find(points[i]);
    if (found == place.end()) continue;
    number[i] = static_cast<int>(input->structure.size());
    input->structure.push_back(known->positions[found->second]);
  }
  const size_t missing = points.size() - input->structure.size();
  if (input->structure.empty()) {
    return bad_input(fmt::format("--structure = '{}': has none of the points of {}, '{}' for one",
                                 settings.structure, settings.input, shown(points[0])));
  }
  if (missing > 0) {
    tell(event, Event::Level::kWarning,
         fmt::format("{} of {} points are not in {} and are left out", missing, points.size(),
                     settings.structure));
  }
  PointTracks kept{.image_count = input->tracks.image_count,
                   .point_count = static_cast<int>(input->structure.size()),
                   .image_size = input->tracks.image_size,
                   .image = {},
                   .point = {},
                   .pixel = {}};
  for (int k = 0; k < input->tracks.size(); ++k) {
    const int point = number[input->tracks.point[k]];
    if (point >= 0) kept.add(input->tracks.image[k], point, input->tracks.pixel[k]);
  }
  input->tracks = std::move(kept);
  return {};
}

}  // namespace

std::string no_motion(const SolveInput& input) {
  const auto repeats = std::ranges::count_if(input.same_as, [](int original) { return original >= 0; });
  const auto pictures = std::ssize(input.names) - repeats;
  if (repeats == 0 || pictures > 2) return {};
  return fmt::format("no motion: {} frames show {} different pictures", input.names.size(), pictures);
}

std::vector<int> shared_with_previous(const PointTracks& tracks) {
  std::vector<std::vector<int>> points(tracks.image_count);
  for (int k = 0; k < tracks.size(); ++k) points[tracks.image[k]].push_back(tracks.point[k]);
  std::vector<int> shared(tracks.image_count, 0), last(tracks.point_count, -2);
  for (int j = 0; j < tracks.image_count; ++j) {
    for (const int point : points[j]) {
      shared[j] += last[point] == j - 1;
      last[point] = j;
    }
  }
  return shared;
}

Result<SolveInput> tracks_from_file(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Eigen::Vector2d size = Eigen::Vector2d::Zero();
  if (!settings.size.empty()) {
    const Result<Eigen::Vector2d> given = parse_size(settings.size);
    if (!given) return given.error();
    size = *given;
  }
  if (auto r = check_fps(settings.fps); !r) return r.error();
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
    tell(callbacks.event, Event::Level::kWarning,
         fmt::format("the images are taken to be {}x{}, as the tracks suggest; --size says it for sure",
                     size.x(), size.y()));
  }
  if (auto r = check_size(settings, size, file->pixel); !r) return r.error();
  SolveInput input;
  input.tracks = {.image_count = static_cast<int>(file->images.size()),
                  .point_count = static_cast<int>(file->points.size()),
                  .image_size = size,
                  .image = std::move(file->image),
                  .point = std::move(file->point),
                  .pixel = std::move(file->pixel)};
  input.in_order = is_in_order(input.tracks);
  input.timestamps = std::move(file->timestamps);
  input.names = std::move(file->images);
  input.keyframe.assign(input.names.size(), 1);
  if (!settings.structure.empty()) {
    if (auto r = keep_known(settings, file->points, callbacks.event, &input); !r) return r.error();
  }
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  return input;
}

}  // namespace raysfm
