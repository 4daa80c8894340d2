#include "raysfm/io/photo_features.h"

#include <opencv2/features2d.hpp>

namespace raysfm {
namespace {

constexpr float kMaxRatio = 0.8f;  // of the distances of the best and the second best

// Best of each row of `from` in `to`, -1 where it is not clearly the best.
std::vector<int> clear_best(const cv::Mat& from, const cv::Mat& to) {
  std::vector<int> best(from.rows, -1);
  if (from.rows == 0 || to.rows < 2) return best;
  std::vector<std::vector<cv::DMatch>> found;
  cv::BFMatcher(cv::NORM_L2).knnMatch(from, to, found, 2);
  for (const auto& two : found) {
    if (two.size() == 2 && two[0].distance < kMaxRatio * two[1].distance) {
      best[two[0].queryIdx] = two[0].trainIdx;
    }
  }
  return best;
}

}  // namespace

struct PhotoFeatures::Photos {
  std::vector<std::vector<Eigen::Vector2d>> pixels;
  std::vector<cv::Mat> descriptors;  // root of each, scaled to unit sum (Arandjelovic and Zisserman 2012)
};

PhotoFeatures::PhotoFeatures() : photos_(std::make_unique<Photos>()) {}
PhotoFeatures::~PhotoFeatures() = default;

void PhotoFeatures::add(const GrayView& image, int max_features) {
  if (image.empty()) {
    photos_->pixels.emplace_back();
    photos_->descriptors.emplace_back();
    return;
  }
  // OpenCV takes pixels that can be written to, and leaves them alone.
  const cv::Mat pixels(image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data),
                       static_cast<size_t>(image.stride));
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  cv::SIFT::create(max_features)->detectAndCompute(pixels, cv::noArray(), points, descriptors);
  std::vector<Eigen::Vector2d>& places = photos_->pixels.emplace_back();
  for (const cv::KeyPoint& p : points) places.emplace_back(p.pt.x, p.pt.y);
  for (int r = 0; r < descriptors.rows; ++r) {
    cv::Mat row = descriptors.row(r);
    row /= std::max(1e-9, cv::norm(row, cv::NORM_L1));
  }
  if (!descriptors.empty()) cv::sqrt(descriptors, descriptors);
  photos_->descriptors.push_back(descriptors);
}

int PhotoFeatures::photos() const {
  return static_cast<int>(photos_->pixels.size());
}

const std::vector<Eigen::Vector2d>& PhotoFeatures::pixels(int photo) const {
  return photos_->pixels[photo];
}

std::vector<std::pair<int, int>> PhotoFeatures::match(int a, int b) const {
  const std::vector<int> forth = clear_best(photos_->descriptors[a], photos_->descriptors[b]);
  const std::vector<int> back = clear_best(photos_->descriptors[b], photos_->descriptors[a]);
  std::vector<std::pair<int, int>> matches;
  for (size_t i = 0; i < forth.size(); ++i) {
    if (forth[i] >= 0 && back[forth[i]] == static_cast<int>(i)) matches.emplace_back(i, forth[i]);
  }
  return matches;
}

}  // namespace raysfm
