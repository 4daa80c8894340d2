#include "raysfm/matching/photo_features.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

constexpr int kWidth = 480, kHeight = 360;

// Blobs of many sizes, so that there is something to find at every scale.
cv::Mat painting(uint64_t seed) {
  Rng rng(seed);
  cv::Mat image(kHeight, kWidth, CV_8U, cv::Scalar(128));
  for (int i = 0; i < 500; ++i) {
    const cv::Point at(static_cast<int>(rng.index(kWidth)), static_cast<int>(rng.index(kHeight)));
    const int size = static_cast<int>(3 + 25 * rng.uniform() * rng.uniform());
    const cv::Scalar grey(rng.uniform(0, 255));
    if (i % 2) {
      cv::circle(image, at, size, grey, cv::FILLED, cv::LINE_AA);
    } else {
      cv::rectangle(image, at, at + cv::Point(size, 1 + size / 2), grey, cv::FILLED);
    }
  }
  cv::GaussianBlur(image, image, {0, 0}, 1);
  return image;
}

GrayImage gray_of(const cv::Mat& image) {
  GrayImage gray(image.cols, image.rows);
  for (int y = 0; y < image.rows; ++y) std::copy_n(image.ptr(y), image.cols, gray.row(y));
  return gray;
}

// The share of matches between the painting and its picture by `b_from_a` that are right, to 1.5 pixels.
double share_of_right_matches(const Eigen::Matrix3d& b_from_a, int* matches) {
  const cv::Mat a = painting(1);
  cv::Mat h(3, 3, CV_64F), b;
  for (int i = 0; i < 9; ++i) h.at<double>(i / 3, i % 3) = b_from_a(i / 3, i % 3);
  cv::warpPerspective(a, b, h, a.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(128));
  const auto features = *make_photo_features();
  EXPECT_TRUE(features->add(gray_of(a).view(), 1500));
  EXPECT_TRUE(features->add(gray_of(b).view(), 1500));
  const auto found = features->match(0, 1, 0.8f);
  *matches = static_cast<int>(found.size());
  int right = 0;
  for (const auto& [in_a, in_b, ratio] : found) {
    const Eigen::Vector2d expected = (b_from_a * features->pixels(0)[in_a].homogeneous()).hnormalized();
    right += (expected - features->pixels(1)[in_b]).norm() < 1.5;
  }
  return found.empty() ? 0 : double(right) / double(found.size());
}

TEST(PhotoFeatures, MatchesFollowTurnsScalesAndTilts) {
  Eigen::Matrix3d centred = Eigen::Matrix3d::Identity();
  centred.topRightCorner<2, 1>() << kWidth / 2, kHeight / 2;
  const auto about_centre = [&](const Eigen::Matrix2d& linear, const Eigen::RowVector2d& tilt) {
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    m.topLeftCorner<2, 2>() = linear;
    m.bottomLeftCorner<1, 2>() = tilt;
    return Eigen::Matrix3d(centred * m * centred.inverse());
  };
  const Eigen::Matrix2d one = Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d turned = Eigen::Rotation2Dd(0.6).toRotationMatrix();
  int matches = 0;
  EXPECT_GT(share_of_right_matches(about_centre(turned, {0, 0}), &matches), 0.9);
  EXPECT_GT(matches, 100);
  EXPECT_GT(share_of_right_matches(about_centre(0.6 * one, {0, 0}), &matches), 0.9);
  EXPECT_GT(matches, 60);
  EXPECT_GT(share_of_right_matches(about_centre(0.9 * turned, {6e-4, -4e-4}), &matches), 0.85);
  EXPECT_GT(matches, 60);
}

TEST(PhotoFeatures, CodesOfMatchesAreAlikeAndOthersAreNot) {
  const cv::Mat a = painting(1);
  cv::Mat b;
  cv::warpAffine(a, b, cv::getRotationMatrix2D({kWidth / 2, kHeight / 2}, 30, 0.9), a.size());
  const auto features = *make_photo_features();
  EXPECT_TRUE(features->add(gray_of(a).view(), 800));
  EXPECT_TRUE(features->add(gray_of(b).view(), 800));
  const std::vector<Descriptor> in_a = features->codes(0), in_b = features->codes(1);
  ASSERT_EQ(in_a.size(), features->pixels(0).size());
  double same = 0, other = 0;
  const auto matches = features->match(0, 1, 0.8f);
  ASSERT_GT(matches.size(), 100u);
  for (const auto& [i, j, ratio] : matches) {
    same += double(distance(in_a[i], in_b[j])) / double(matches.size());
    other += double(distance(in_a[i], in_b[(j + 7) % in_b.size()])) / double(matches.size());
  }
  EXPECT_LT(same, 50);
  EXPECT_GT(other, 90);
}

TEST(PhotoFeatures, ImagesOfDifferentThingsMatchHardly) {
  const auto features = *make_photo_features();
  EXPECT_TRUE(features->add(gray_of(painting(1)).view(), 1500));
  EXPECT_TRUE(features->add(gray_of(painting(2)).view(), 1500));
  EXPECT_TRUE(features->add(gray_of(cv::Mat(48, 64, CV_8U, cv::Scalar(90))).view(), 1500));  // nothing in it
  EXPECT_EQ(features->photos(), 3);
  EXPECT_GT(features->pixels(0).size(), 300u);
  EXPECT_LT(features->match(0, 1, 0.8f).size(), features->pixels(0).size() / 10);
  EXPECT_TRUE(features->pixels(2).empty());
  EXPECT_TRUE(features->match(0, 2, 0.8f).empty());
  EXPECT_TRUE(features->match(2, 0, 0.8f).empty());
}

TEST(PhotoFeatures, MatchesAreOneToOneAndTheSameBothWays) {
  const cv::Mat a = painting(1);
  cv::Mat b;
  cv::resize(a, b, {}, 0.8, 0.8, cv::INTER_AREA);
  const auto features = *make_photo_features();
  EXPECT_TRUE(features->add(gray_of(a).view(), 800));
  EXPECT_TRUE(features->add(gray_of(b).view(), 800));
  EXPECT_LE(features->pixels(0).size(), 801u);  // OpenCV keeps ties
  auto forth = features->match(0, 1, 0.8f), back = features->match(1, 0, 0.8f);
  for (PhotoMatch& match : back) std::swap(match.in_a, match.in_b);
  std::ranges::sort(back, {}, &PhotoMatch::in_a);
  EXPECT_EQ(forth, back);
  const auto clear = features->match(0, 1, 0.5f);
  EXPECT_GT(clear.size(), forth.size() / 4);
  EXPECT_LT(clear.size(), forth.size());
  std::erase_if(forth, [](const PhotoMatch& match) { return match.ratio >= 0.5f; });
  EXPECT_EQ(forth, clear);
}

}  // namespace
}  // namespace raysfm
