#pragma once

#include <cmath>
#include <numbers>

#include "support/texture.h"

namespace raysfm::testing_support {

constexpr double kSquare = 24;  // pixels; side of the squares, and width of the stripes, at sigma up to 4

// -1 to 1: a square wave of half period `side`, blurred by a Gaussian of `sigma` pixels.
inline double soft_wave(double x, double side, double sigma) {
  const double place = x / side - std::floor(x / side);
  const double edge = side * (place < 0.5 ? place : place - 1);  // from the nearest edge
  const bool rising = std::fmod(std::floor(x / side + 0.5), 2.0) == 0;
  return (rising ? 1 : -1) * std::erf(edge / (std::numbers::sqrt2 * sigma));
}

// Pixel p of the image is 128 + 60 * wave(p) plus normal noise.
template <typename F>
GrayImage soft_image(int width, int height, F wave, double noise = 0) {
  GrayImage image(width, height);
  Rng rng(5, 80);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.row(y)[x] = to_grey(128 + 60 * wave(x + 0.37, y + 0.71) + (noise > 0 ? noise * rng.normal() : 0));
    }
  }
  return image;
}

// Stripes whose normal is `degrees` from the rows.
inline GrayImage soft_stripes(int width, int height, double degrees, double sigma) {
  const double angle = degrees * std::numbers::pi / 180, side = std::max(kSquare, 8 * sigma);
  return soft_image(width, height, [&](double x, double y) {
    return soft_wave(std::cos(angle) * x + std::sin(angle) * y, side, sigma);
  });
}

// A chess board turned by 5 degrees, so that its edges are at all fractions of a pixel.
inline GrayImage soft_board(int width, int height, double sigma, double noise = 0) {
  const double c = std::cos(0.087), s = std::sin(0.087);
  return soft_image(
      width, height,
      [&](double x, double y) {
        return soft_wave(c * x + s * y, kSquare, sigma) * soft_wave(c * y - s * x, kSquare, sigma);
      },
      noise);
}

}  // namespace raysfm::testing_support
