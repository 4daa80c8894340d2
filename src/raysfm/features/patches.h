#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <vector>

#include "raysfm/image/image.h"

namespace raysfm {

constexpr int kPatchRadius = 5;                      // pixels
constexpr int kPatchSide = 2 * kPatchRadius + 1;     // pixels
constexpr int kPatchArea = kPatchSide * kPatchSide;  // 121
constexpr int kPatchStride = 128;                    // bytes from one patch to the next, a multiple of 64

// Square patches of kPatchSide x kPatchSide pixels, row by row, with their mean taken away and scaled to the
// range of int8 (each with its own scale), padded with zeros. The zero-mean normalised cross-correlation of
// two patches is the dot product of their bytes times both inverse norms.
class PatchSet {
 public:
  int size() const { return static_cast<int>(inverse_norms_.size()); }
  // kPatchStride bytes, aligned to 64.
  const int8_t* patch(int i) const { return data_.get() + size_t{kPatchStride} * i; }
  // 1 / norm of the bytes. Zero for a patch that has no texture or leaves the image: its correlation with any
  // other is then zero.
  float inverse_norm(int i) const { return inverse_norms_[i]; }
  bool valid(int i) const { return inverse_norms_[i] > 0; }

  // For those who fill the set. Contents are unspecified after resize().
  void resize(int size);
  int8_t* mutable_patch(int i) { return data_.get() + size_t{kPatchStride} * i; }
  void set_inverse_norm(int i, float value) { inverse_norms_[i] = value; }

 private:
  struct Free {
    void operator()(int8_t* p) const { ::operator delete (p, std::align_val_t{64}); }
  };
  std::unique_ptr<int8_t, Free> data_;
  size_t capacity_ = 0;  // patches
  std::vector<float> inverse_norms_;
};

// Patches around `pixels`, axis-aligned, sampled bilinearly at pixels rounded to an eighth: rounded to whole
// pixels, 3 to 10 % of the matches of real frames are lost. A patch that leaves the image is not valid.
void extract_patches(const GrayView& image, std::span<const Eigen::Vector2f> pixels, PatchSet* patches);

// Patches as another view would see them: offset o of patch i samples the image at
// pixels[i] + image_from_target[i] * o, bilinearly. `image_from_target` has as many elements as `pixels`.
// Where it enlarges o by more than about 1.5 the sampling is too sparse for the image; with the levels of a
// pyramid (image/pyramid.h, level 0 first, at least one) the level is chosen that matches.
void extract_warped_patches(std::span<const GrayView> levels, std::span<const Eigen::Vector2f> pixels,
                            std::span<const Eigen::Matrix2f> image_from_target, PatchSet* patches);
void extract_warped_patches(const GrayView& image, std::span<const Eigen::Vector2f> pixels,
                            std::span<const Eigen::Matrix2f> image_from_target, PatchSet* patches);

// Zero-mean normalised cross-correlation in [-1, 1] of patch i of `a` and patch j of `b`.
float zncc(const PatchSet& a, int i, const PatchSet& b, int j);

}  // namespace raysfm
