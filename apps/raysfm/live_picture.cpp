#include "live_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "raysfm/frames/jpeg_writer.h"

namespace raysfm::app {
namespace {

constexpr int kMostSide = 640, kQuality = 80;

GrayView small_enough(const Octaves& octaves) {
  int octave = octaves.first();
  while (octave < octaves.last() &&
         std::max(octaves.at(octave).width, octaves.at(octave).height) > kMostSide) {
    ++octave;
  }
  return octaves.at(octave);
}

double tenths(float pixels) {
  return std::round(10.0 * pixels) / 10;
}

}  // namespace

Result<std::string> picture_of(const View& view, int camera) {
  if (camera < 0 || camera >= static_cast<int>(view.cameras.size())) return bad_input("no such picture");
  const GrayView grey = small_enough(*view.cameras[camera].octaves);
  Image<uint8_t> rgb(3 * grey.width, grey.height);
  for (int y = 0; y < grey.height; ++y) {
    for (int x = 0; x < 3 * grey.width; ++x) rgb.row(y)[x] = grey.row(y)[x / 3];
  }
  return encode_jpeg(rgb.view(), kQuality);
}

std::string features_of(const NewestView& newest, int camera) {
  nlohmann::json tracks = nlohmann::json::array();
  for (const NewestView::Match& match : newest.matches) {
    if (match.camera != camera) continue;
    nlohmann::json& pixels = tracks.emplace_back(nlohmann::json::array());
    pixels.push_back(tenths(match.pixel.x()));
    pixels.push_back(tenths(match.pixel.y()));
    for (const Eigen::Vector2f& pixel : match.before) {
      pixels.push_back(tenths(pixel.x()));
      pixels.push_back(tenths(pixel.y()));
    }
  }
  const CameraView& image = newest.view->cameras[camera];
  const size_t seen = tracks.size();
  return nlohmann::json{{"size", {image.width, image.height}},
                        {"seen", seen},
                        {"note", fmt::format("frame {}: {} points matched", newest.view->frame, seen)},
                        {"tracks", std::move(tracks)}}
      .dump();
}

}  // namespace raysfm::app
