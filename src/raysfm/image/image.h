#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>

namespace raysfm {

// Rows of pixels that somebody else owns. Row r starts at data + r * stride (in elements). Pixel (x, y)
// covers [x - 0.5, x + 0.5) x [y - 0.5, y + 0.5): centres are at integers.
template <typename T>
struct ImageView {
  T* data = nullptr;
  int width = 0;
  int height = 0;
  ptrdiff_t stride = 0;

  T* row(int y) const { return data + y * stride; }
  T& operator()(int x, int y) const { return row(y)[x]; }
  bool empty() const { return width == 0 || height == 0; }
  operator ImageView<const T>() const { return {data, width, height, stride}; }
};

// Grey levels that are only read.
using GrayView = ImageView<const uint8_t>;

// An image that owns its pixels. Rows start at multiples of 64 bytes, and 64 bytes behind the last row are
// readable, so that vector loads may run over the right border.
template <typename T>
class Image {
 public:
  Image() = default;
  // Pixels are not initialised. width, height >= 0 and width * height * sizeof(T) < 2^31.
  Image(int width, int height)
      : width_(width),
        height_(height),
        stride_(padded(width)),
        data_(static_cast<T*>(::operator new (stride_* height * sizeof(T) + 64, std::align_val_t{64}))) {}

  // Pixels are not kept, the memory is where the size stays the same.
  void resize(int width, int height) {
    if (width != width_ || height != height_) *this = Image(width, height);
  }

  int width() const { return width_; }
  int height() const { return height_; }
  bool empty() const { return width_ == 0 || height_ == 0; }
  ImageView<T> view() { return {data_.get(), width_, height_, stride_}; }
  ImageView<const T> view() const { return {data_.get(), width_, height_, stride_}; }
  operator ImageView<T>() { return view(); }
  operator ImageView<const T>() const { return view(); }
  T* row(int y) { return data_.get() + y * stride_; }
  const T* row(int y) const { return data_.get() + y * stride_; }

 private:
  struct Free {
    void operator()(T* p) const { ::operator delete (p, std::align_val_t{64}); }
  };
  static ptrdiff_t padded(int width) {
    constexpr ptrdiff_t kStep = 64 / sizeof(T);
    return (width + kStep - 1) / kStep * kStep;
  }

  int width_ = 0;
  int height_ = 0;
  ptrdiff_t stride_ = 0;
  std::unique_ptr<T, Free> data_;
};

// Grey levels, 0 to 255.
using GrayImage = Image<uint8_t>;

}  // namespace raysfm
