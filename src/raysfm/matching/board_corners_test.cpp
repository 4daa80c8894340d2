#include "raysfm/matching/board_corners.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace raysfm {
namespace {

constexpr int kSide = 24, kMargin = 40;  // pixels

// A board of squares that is seen straight; pixel edges are those of squares. `first`: of the first square.
GrayImage straight_board(int columns, int rows, bool dark_first) {
  GrayImage image((columns + 1) * kSide + 2 * kMargin, (rows + 1) * kSide + 2 * kMargin);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      const int column = (x - kMargin) / kSide, row = (y - kMargin) / kSide;
      const bool inside = x >= kMargin && y >= kMargin && column <= columns && row <= rows;
      const bool dark = inside && ((column + row) % 2 == 0) == dark_first;
      image.row(y)[x] = dark ? 20 : 230;
    }
  }
  return image;
}

GrayImage upside_down(const GrayImage& image) {
  GrayImage turned(image.width(), image.height());
  for (int y = 0; y < image.height(); ++y) {
    std::reverse_copy(image.row(y), image.row(y) + image.width(), turned.row(image.height() - 1 - y));
  }
  return turned;
}

TEST(BoardCorners, AreWhereTheSquaresMeet) {
  const GrayImage image = straight_board(7, 5, true);
  const auto corners = find_board_corners(image.view(), 7, 5);
  ASSERT_TRUE(corners);
  ASSERT_EQ(corners->size(), 35U);
  std::vector<Eigen::Vector2d> expected;
  for (int i = 0; i < 35; ++i) {
    expected.emplace_back(kMargin + (i % 7 + 1) * kSide - 0.5, kMargin + (i / 7 + 1) * kSide - 0.5);
  }
  // Both numbers are odd: which of the two outer corners comes first is not known.
  if (((*corners)[0] - expected[0]).norm() > kSide) std::reverse(expected.begin(), expected.end());
  for (int i = 0; i < 35; ++i) EXPECT_LT(((*corners)[i] - expected[i]).norm(), 0.05) << i;
}

TEST(BoardCorners, AllImagesMeanTheSameFirstCorner) {
  for (const bool dark_first : {true, false}) {
    const GrayImage image = straight_board(6, 5, dark_first), turned = upside_down(image);
    const auto a = find_board_corners(image.view(), 6, 5), b = find_board_corners(turned.view(), 6, 5);
    ASSERT_TRUE(a && b);
    ASSERT_EQ(a->size(), 30U);
    ASSERT_EQ(b->size(), 30U);
    for (int i = 0; i < 30; ++i) {
      const Eigen::Vector2d back = Eigen::Vector2d(image.width() - 1, image.height() - 1) - (*b)[i];
      EXPECT_LT((back - (*a)[i]).norm(), 0.1) << i;
    }
    // The first square between corners is dark.
    const Eigen::Vector2d middle = 0.25 * ((*a)[0] + (*a)[1] + (*a)[6] + (*a)[7]);
    EXPECT_LT(image.row(static_cast<int>(middle.y()))[static_cast<int>(middle.x())], 100);
  }
}

TEST(BoardCorners, NoneWhereThereIsNoneOrAnother) {
  const GrayImage image = straight_board(7, 5, true);
  GrayImage grey(200, 150);
  for (int y = 0; y < 150; ++y) std::fill_n(grey.row(y), 200, 128);
  EXPECT_TRUE(find_board_corners(grey.view(), 7, 5)->empty());
  EXPECT_TRUE(find_board_corners(GrayView{}, 7, 5)->empty());
  EXPECT_TRUE(find_board_corners(image.view(), 6, 4)->empty());
  EXPECT_TRUE(find_board_corners(image.view(), 9, 6)->empty());
  EXPECT_EQ(*guess_board_size(image.view()), (std::array{7, 5}));
  EXPECT_EQ(*guess_board_size(grey.view()), (std::array{0, 0}));
}

}  // namespace
}  // namespace raysfm
