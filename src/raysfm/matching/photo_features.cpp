#include "raysfm/matching/photo_features.h"

#include <fmt/format.h>

#include <algorithm>
#include <new>
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

// The descriptors are the roots of SIFT's, scaled to unit sum (Arandjelovic and Zisserman 2012).
class SiftFeatures : public PhotoFeatures {
 public:
  Result<void> add(const GrayView& image, int max_features) override try {
    std::vector<cv::KeyPoint> points;
    cv::Mat descriptors;
    if (!image.empty()) {
      // OpenCV takes pixels that can be written to, and leaves them alone.
      const cv::Mat pixels(image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data),
                           static_cast<size_t>(image.stride));
      cv::SIFT::create(max_features)->detectAndCompute(pixels, cv::noArray(), points, descriptors);
    }
    for (int r = 0; r < descriptors.rows; ++r) {
      cv::Mat row = descriptors.row(r);
      row /= std::max(1e-9, cv::norm(row, cv::NORM_L1));
    }
    if (!descriptors.empty()) cv::sqrt(descriptors, descriptors);
    std::vector<Eigen::Vector2d>& places = pixels_.emplace_back();
    for (const cv::KeyPoint& p : points) places.emplace_back(p.pt.x, p.pt.y);
    descriptors_.push_back(descriptors);
    return {};
  } catch (const cv::Exception& e) {
    if (e.code == cv::Error::StsNoMem) throw std::bad_alloc();
    return internal_error(fmt::format("points of photo {}: {}", photos(), e.err));
  }

  int photos() const override { return static_cast<int>(pixels_.size()); }
  const std::vector<Eigen::Vector2d>& pixels(int photo) const override { return pixels_[photo]; }

  std::vector<std::pair<int, int>> match(int a, int b) const override try {
    const std::vector<int> forth = clear_best(descriptors_[a], descriptors_[b]);
    const std::vector<int> back = clear_best(descriptors_[b], descriptors_[a]);
    std::vector<std::pair<int, int>> matches;
    for (size_t i = 0; i < forth.size(); ++i) {
      if (forth[i] >= 0 && back[forth[i]] == static_cast<int>(i)) matches.emplace_back(i, forth[i]);
    }
    return matches;
  } catch (const cv::Exception& e) {
    if (e.code == cv::Error::StsNoMem) throw std::bad_alloc();
    throw;
  }

 private:
  std::vector<std::vector<Eigen::Vector2d>> pixels_;
  std::vector<cv::Mat> descriptors_;
};

}  // namespace

Result<std::unique_ptr<PhotoFeatures>> make_photo_features() {
  return std::unique_ptr<PhotoFeatures>(std::make_unique<SiftFeatures>());
}

}  // namespace raysfm
