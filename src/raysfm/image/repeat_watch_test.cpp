#include "raysfm/image/repeat_watch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::Texture;
using testing_support::to_grey;

constexpr int kWidth = 128, kHeight = 96;

// A picture moved to the right, as a sensor with so much noise (grey levels) sees it.
GrayImage picture(double moved, double noise, uint64_t seed) {
  static const Texture texture(5, 7, 80, 35);
  Rng rng(seed, 3);
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      image.row(y)[x] = to_grey(texture(Eigen::Vector2d(x - moved, y)) + noise * rng.normal());
    }
  }
  return image;
}

// What an encoder makes of a picture: one block of 8 x 8 in `every` has other errors than the last time.
GrayImage encoded(const GrayImage& image, uint32_t every, uint64_t seed) {
  Rng rng(seed, 4);
  GrayImage out(kWidth, kHeight);
  for (int by = 0; by < kHeight; by += 8) {
    for (int bx = 0; bx < kWidth; bx += 8) {
      const bool changes = rng.index(every) == 0;
      const double wave = rng.uniform(0.2, 0.8), height = rng.uniform(-4, 4);
      for (int y = by; y < by + 8; ++y) {
        for (int x = bx; x < bx + 8; ++x) {
          const double error = changes ? height * std::cos(wave * (x + 2 * y)) : 0;
          out.row(y)[x] = to_grey(image.row(y)[x] + error);
        }
      }
    }
  }
  return out;
}

// Of each picture: the one it is said to repeat.
std::vector<int> originals(const std::vector<GrayImage>& film) {
  RepeatWatch watch;
  std::vector<int> out;
  for (size_t i = 0; i < film.size(); ++i) {
    const GrayView shown = film[i];
    out.push_back(watch.original_of(static_cast<int>(i), {&shown, 1}));
  }
  EXPECT_EQ(watch.repeats(), film.size() - std::ranges::count(out, -1));
  return out;
}

constexpr int kNone = -1;

TEST(RepeatWatch, CopiesAreThoseOfTheNewestPictureInAnyRhythm) {
  std::vector<GrayImage> film;
  std::vector<int> truth;
  int shown = 0;
  for (const int times : {3, 3, 2, 3, 1, 1, 2, 5, 1}) {
    const auto first = static_cast<int>(film.size());
    for (int i = 0; i < times; ++i) {
      film.push_back(picture(0.8 * shown, 2, shown));
      truth.push_back(i == 0 ? kNone : first);
    }
    ++shown;
  }
  EXPECT_EQ(originals(film), truth);
}

TEST(RepeatWatch, CopiesThatAnEncoderChangedAreCopies) {
  std::vector<GrayImage> film;
  std::vector<int> truth;
  for (int i = 0; i < 30; ++i) {
    const int shown = i / 3;
    const GrayImage sensed = picture(0.7 * shown, 2, shown);
    film.push_back(i % 3 == 0 ? encoded(sensed, 1, i) : encoded(film[3 * shown], 6, i));
    truth.push_back(i % 3 == 0 ? kNone : 3 * shown);
  }
  // Before there is a rhythm nothing tells what an encoder does.
  std::vector<int> told = originals(film);
  std::fill_n(told.begin(), 12, kNone), std::fill_n(truth.begin(), 12, kNone);
  EXPECT_EQ(told, truth);
}

TEST(RepeatWatch, ACameraThatComesToAStandRepeatsNothing) {
  std::vector<GrayImage> film;
  for (int i = 0; i < 20; ++i) film.push_back(picture(0.7 * std::min(i, 8), 2, std::min(i, 8)));
  for (int i = 9; i < 20; ++i) film[i] = encoded(film[8], 4, i);
  EXPECT_EQ(originals(film), std::vector<int>(20, kNone));
}

TEST(RepeatWatch, ACameraThatStandsWithNoiseRepeatsNothing) {
  for (const double noise : {1.0, 2.0, 6.0}) {
    std::vector<GrayImage> film;
    for (int i = 0; i < 5; ++i) film.push_back(picture(i, noise, i));
    for (int i = 5; i < 15; ++i) film.push_back(picture(4, noise, i));
    EXPECT_EQ(originals(film), std::vector<int>(15, kNone)) << noise;
  }
}

// What moves too little to be seen is a copy, but not for long: it adds up.
TEST(RepeatWatch, ASlowCameraIsNeverBehindByMoreThanWhatNobodySees) {
  for (const double step : {0.003, 0.01, 0.03, 0.1}) {
    std::vector<GrayImage> film;
    for (int i = 0; i < 40; ++i) film.push_back(picture(step * i, 0, 0));
    const std::vector<int> told = originals(film);
    for (int i = 0; i < 40; ++i) {
      EXPECT_LE(step * (told[i] >= 0 ? i - told[i] : 0), 0.05) << step << " at " << i;
    }
    if (step >= 0.03) {
      EXPECT_EQ(std::ranges::count(told, kNone), 40) << step;
    }
  }
}

// A camera that shakes is slow where it turns back.
TEST(RepeatWatch, ACameraThatTurnsBackRepeatsNothing) {
  std::vector<GrayImage> film;
  for (int i = 0; i < 24; ++i) film.push_back(picture(6 * std::cos(0.4 * i), 0.5, i));
  EXPECT_EQ(originals(film), std::vector<int>(24, kNone));
}

TEST(RepeatWatch, EveryStreamMustRepeat) {
  const GrayImage a = picture(0, 2, 0), b = picture(1, 2, 1), c = picture(2, 2, 2);
  RepeatWatch watch;
  const auto told = [&](int frame, const GrayImage& left, const GrayImage& right) {
    const GrayView pictures[] = {left, right};
    return watch.original_of(frame, pictures);
  };
  EXPECT_EQ(told(0, a, b), kNone);
  EXPECT_EQ(told(1, a, c), kNone);
  EXPECT_EQ(told(2, a, c), 1);
  EXPECT_EQ(told(3, b, c), kNone);
}

TEST(RepeatWatch, APictureOfAnotherSizeRepeatsNothing) {
  const GrayImage image = picture(0, 2, 0);
  const GrayView all = image, part = {all.data, kWidth, kHeight / 2, all.stride};
  RepeatWatch watch;
  EXPECT_EQ(watch.original_of(0, {&all, 1}), kNone);
  EXPECT_EQ(watch.original_of(1, {&part, 1}), kNone);
  EXPECT_EQ(watch.original_of(2, {&part, 1}), 1);
}

TEST(RepeatWatch, ItGoesOnFromItsState) {
  const GrayImage image = picture(0, 2, 0);
  const GrayView shown = image;
  RepeatWatch watch, other;
  watch.original_of(0, {&shown, 1});
  ArchiveWriter writer;
  archive(writer, watch);
  ArchiveReader reader(writer.content());
  archive(reader, other);
  ASSERT_TRUE(reader.at_end());
  EXPECT_EQ(other.original_of(1, {&shown, 1}), 0);
}

}  // namespace
}  // namespace raysfm
