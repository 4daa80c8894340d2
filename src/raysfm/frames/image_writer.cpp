#include "raysfm/frames/image_writer.h"

#include <fmt/format.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string_view>
#include <vector>

#include "raysfm/files/atomic_file.h"

namespace raysfm {

namespace {

Result<void> write(const std::filesystem::path& path, ImageView<const uint8_t> view, int channels) {
  if (view.empty()) return bad_input(fmt::format("{}: an image of no pixels is not allowed", path.string()));
  const cv::Mat image(view.height, view.width / channels, CV_8UC(channels), const_cast<uint8_t*>(view.data),
                      static_cast<size_t>(view.stride));
  std::vector<uint8_t> bytes;
  // Noisy images hardly shrink further; the lowest level is several times faster.
  bool encoded = false;
  try {
    encoded = cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 1});
  } catch (const cv::Exception&) {  // no memory
  }
  if (!encoded) return internal_error(fmt::format("{}: the image could not be encoded", path.string()));
  return write_file(path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

}  // namespace

Result<void> write_png(const std::filesystem::path& path, GrayView gray) {
  return write(path, gray, 1);
}

Result<void> write_color_png(const std::filesystem::path& path, ImageView<const uint8_t> bgr) {
  return write(path, bgr, 3);
}

}  // namespace raysfm
