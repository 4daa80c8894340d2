#include "raysfm/io/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "raysfm/io/png_chunks.h"
#include "raysfm/io/text_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr uintmax_t kMaxFileBytes = 512u << 20;
constexpr int kMaxSide = 32768;

bool begins_like_image(std::string_view head) {
  const bool pnm = head.size() > 2 && head[0] == 'P' && head[1] >= '1' && head[1] <= '6' &&
                   std::isspace(static_cast<unsigned char>(head[2]));
  const bool webp = head.starts_with("RIFF") && head.substr(0, 12).ends_with("WEBP");
  return pnm || webp || head.starts_with("\x89PNG\r\n\x1a\n") || head.starts_with("\xff\xd8\xff") ||
         head.starts_with("II*\0"sv) || head.starts_with("MM\0*"sv) ||
         (head.starts_with("BM") && head.size() > 14);
}

// Whether the mark at the end of a JPEG file is missing. libjpeg fills what is missing with grey and says
// nothing.
bool cut_short(std::string_view bytes) {
  constexpr size_t kTail = 65536;  // some cameras append data of their own
  const std::string_view tail = bytes.substr(bytes.size() - std::min(bytes.size(), kTail));
  return bytes.starts_with("\xff\xd8\xff") && tail.find("\xff\xd9") == std::string_view::npos;
}

template <typename Pixels>
Pixels copied(const cv::Mat& mat) {
  const int values = mat.cols * mat.channels();
  Pixels image(values, mat.rows);
  for (int y = 0; y < mat.rows; ++y) std::memcpy(image.row(y), mat.ptr(y), values);
  return image;
}

DecodedImage converted(cv::Mat mat) {
  if (mat.depth() == CV_16U) mat.convertTo(mat, CV_8U, 1.0 / 257);
  if (mat.channels() == 4) cv::cvtColor(mat, mat, cv::COLOR_BGRA2BGR);
  if (mat.channels() == 2) cv::extractChannel(mat, mat, 0);
  DecodedImage image;
  if (mat.channels() == 1) {
    image.gray = copied<GrayImage>(mat);
    return image;
  }
  cv::Mat gray;
  cv::cvtColor(mat, gray, cv::COLOR_BGR2GRAY);
  image.gray = copied<GrayImage>(gray);
  cv::cvtColor(mat, mat, cv::COLOR_BGR2RGB);
  image.colors.rgb = copied<Image<uint8_t>>(mat);
  return image;
}

cv::Mat decoded(const std::string& file) {
  const bool png = file.starts_with("\x89PNG");
  const std::optional<std::string> chunks = png ? pixel_chunks_of_png(file) : std::nullopt;
  if (cut_short(file) || (png && !chunks)) return {};
  const std::string& bytes = png ? *chunks : file;
  // OpenCV would print on its own what is returned as an error here.
  [[maybe_unused]] static const auto silenced =
      cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  try {
    const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
    return cv::imdecode(raw, cv::IMREAD_UNCHANGED);
  } catch (const std::exception&) {  // cv::Exception on broken headers, bad_alloc on absurd sizes
    return {};
  }
}

}  // namespace

bool is_image_file(const fs::path& path) {
  std::array<char, 16> head{};
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), head.size());
  return begins_like_image({head.data(), static_cast<size_t>(file.gcount())});
}

Result<DecodedImage> read_image(const fs::path& path) {
  const Result<std::string> bytes = read_text_file(path, kMaxFileBytes);
  if (!bytes) return bytes.error();
  if (!begins_like_image(*bytes)) {
    return bad_input(fmt::format("{}: no image; allowed: PNG, JPEG, BMP, TIFF, PNM, WebP", path.string()));
  }
  const cv::Mat mat = decoded(*bytes);
  if (mat.empty())
    return bad_input(fmt::format("{}: the image is damaged and cannot be decoded", path.string()));
  if (mat.depth() != CV_8U && mat.depth() != CV_16U) {
    return bad_input(fmt::format("{}: pixels of another type; allowed: 8 or 16 bits", path.string()));
  }
  if (mat.cols > kMaxSide || mat.rows > kMaxSide || int64_t{mat.cols} * mat.rows > int64_t{1} << 29) {
    return bad_input(fmt::format("{}: {} x {} pixels; allowed: sides up to {}, 2^29 pixels", path.string(),
                                 mat.cols, mat.rows, kMaxSide));
  }
  return converted(mat);
}

Result<GrayImage> read_mask(const fs::path& path, int width, int height) {
  Result<DecodedImage> image = read_image(path);
  if (!image) return image.error();
  GrayImage mask = std::move(image->gray);
  if (mask.width() != width || mask.height() != height) {
    return bad_input(fmt::format("{}: the mask is {} x {}; allowed: the camera's {} x {}", path.string(),
                                 mask.width(), mask.height(), width, height));
  }
  for (int y = 0; y < height; ++y) {
    for (uint8_t* p = mask.row(y); p != mask.row(y) + width; ++p) *p = *p > 127 ? 255 : 0;
  }
  return mask;
}

}  // namespace raysfm
