#include "raysfm/matching/photo_features.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <new>
#include <opencv2/features2d.hpp>

#include "raysfm/matching/nearest_descriptors.h"

namespace raysfm {
namespace {

constexpr int kLength = DescriptorTable::kLength;
// Of a point at least, of the largest there can be: with OpenCV's 0.04 photos that share little with the
// others stay without a pose, with 0.02 the time of a few photos doubles and focal lengths are no better.
constexpr double kContrast = 0.03;
constexpr int kLayers = 3;  // of an octave, as Lowe has it

// 1 where there is no second best, or both are the same.
float ratio_of(const NearestTwo& nearest) {
  if (nearest.second >= DescriptorTable::kFar || nearest.first >= nearest.second) return 1;
  return std::sqrt(static_cast<float>(nearest.first) / static_cast<float>(nearest.second));
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
      cv::SIFT::create(max_features, kLayers, kContrast)
          ->detectAndCompute(pixels, cv::noArray(), points, descriptors);
    }
    DescriptorTable& table = descriptors_.emplace_back();
    for (int r = 0; r < descriptors.rows; ++r) {
      Eigen::Matrix<float, kLength, 1> row(descriptors.ptr<float>(r));
      row = (row / std::max(1e-9F, row.sum())).cwiseSqrt();
      table.add(std::span<const float, kLength>(row.data(), kLength));
    }
    std::vector<Eigen::Vector2d>& places = pixels_.emplace_back();
    for (const cv::KeyPoint& p : points) places.emplace_back(p.pt.x, p.pt.y);
    return {};
  } catch (const cv::Exception& e) {
    if (e.code == cv::Error::StsNoMem) throw std::bad_alloc();
    return internal_error(fmt::format("points of photo {}: {}", photos(), e.err));
  }

  int photos() const override { return static_cast<int>(pixels_.size()); }
  const std::vector<Eigen::Vector2d>& pixels(int photo) const override { return pixels_[photo]; }

  std::vector<PhotoMatch> match(int a, int b, float max_ratio) const override {
    std::vector<NearestTwo> forth, back;
    find_nearest_two(descriptors_[a], descriptors_[b], &forth, &back);
    std::vector<PhotoMatch> matches;
    for (int i = 0; i < static_cast<int>(forth.size()); ++i) {
      const int other = forth[i].index;
      if (other < 0 || back[other].index != i) continue;
      const float ratio = std::max(ratio_of(forth[i]), ratio_of(back[other]));
      if (ratio < max_ratio) matches.push_back({i, other, ratio});
    }
    return matches;
  }

  // Whether a number of a descriptor is larger than that of the next cell, and than another of its own: the
  // cells have eight directions each.
  std::vector<Descriptor> codes(int photo) const override {
    constexpr int kDirections = 8, kOther = 3;
    const DescriptorTable& table = descriptors_[photo];
    std::vector<Descriptor> codes(table.size());
    for (int r = 0; r < table.size(); ++r) {
      for (int i = 0; i < kLength; ++i) {
        const int cell = i - i % kDirections;
        const int next = (i + kDirections) % kLength, other = cell + (i + kOther) % kDirections;
        codes[r].bits[i / 64] |= uint64_t{table.number(r, i) > table.number(r, next)} << (i % 64);
        codes[r].bits[2 + i / 64] |= uint64_t{table.number(r, i) > table.number(r, other)} << (i % 64);
      }
    }
    return codes;
  }

 private:
  std::vector<std::vector<Eigen::Vector2d>> pixels_;
  std::vector<DescriptorTable> descriptors_;
};

}  // namespace

Result<std::unique_ptr<PhotoFeatures>> make_photo_features() {
  return std::unique_ptr<PhotoFeatures>(std::make_unique<SiftFeatures>());
}

}  // namespace raysfm
