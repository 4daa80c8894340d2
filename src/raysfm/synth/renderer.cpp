#include "raysfm/synth/renderer.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>

#include "raysfm/core/random.h"
#include "raysfm/synth/shade.h"

namespace raysfm::synth {

namespace {

int root(int samples) {
  return static_cast<int>(std::lround(std::sqrt(samples)));
}

int64_t grid_points(const Camera& camera, int samples) {
  const int64_t n = root(samples), margin = n / 2;
  return (camera.width * n + 2 * margin + kRayPack) * (camera.height * n + 2 * margin);
}

// Tent of half width one pixel, sampled at the grid points around a pixel's centre; sums to one.
std::vector<float> tent_weights(int per_pixel) {
  std::vector<float> weights;
  const int margin = per_pixel / 2;
  double sum = 0;
  for (int k = -margin; k < per_pixel + margin; ++k) {
    const double offset = (k + 0.5) / per_pixel - 0.5;
    weights.push_back(static_cast<float>(std::max(0.0, 1.0 - std::abs(offset))));
    sum += weights.back();
  }
  for (float& w : weights) w = static_cast<float>(w / sum);
  return weights;
}

// Gaussian noise for one row of pixels. It takes 4096 values of equal probability, so that one random number
// gives four of them.
class NoiseRow {
 public:
  NoiseRow(double deviation, uint64_t seed, uint64_t stream)
      : deviation_(static_cast<float>(deviation)), random_(seed, stream) {}

  float next() {
    if (deviation_ == 0.f) return 0.f;
    if (left_ == 0) bits_ = random_.next(), left_ = 4;
    const size_t value = bits_ & (kValues - 1);
    --left_;
    bits_ >>= 16;
    return deviation_ * values()[value];
  }

 private:
  static constexpr int kValues = 4096;

  // Quantiles of the normal distribution in the middle of each class, scaled to a standard deviation of one.
  static const std::array<float, kValues>& values() {
    static const std::array<float, kValues> table = [] {
      std::array<double, kValues> x;
      double power = 0;
      for (int i = 0; i < kValues; ++i) {
        const double p = (i + 0.5) / kValues;
        double low = -5, high = 5;
        for (int k = 0; k < 50; ++k) {
          const double middle = 0.5 * (low + high);
          (0.5 * std::erfc(-middle / std::numbers::sqrt2) < p ? low : high) = middle;
        }
        x[static_cast<size_t>(i)] = low;
        power += low * low / kValues;
      }
      std::array<float, kValues> scaled;
      for (size_t i = 0; i < kValues; ++i) scaled[i] = static_cast<float>(x[i] / std::sqrt(power));
      return scaled;
    }();
    return table;
  }

  float deviation_;
  Rng random_;
  uint64_t bits_ = 0;
  int left_ = 0;
};

}  // namespace

bool fits_in_memory(const Camera& camera, int samples) {
  return grid_points(camera, samples) <= kMaxGridPoints;
}

RayGrid::RayGrid(const Camera& camera, int samples, ThreadPool& pool)
    : per_pixel(root(samples)),
      margin(per_pixel / 2),
      width(camera.width * per_pixel + 2 * margin),
      height(camera.height * per_pixel + 2 * margin),
      stride((width + kRayPack - 1) / kRayPack * kRayPack) {
  compute_rays(camera, pool);
  pool.parallel_for(height, [&](int y) { compute_spread(y); });
}

void RayGrid::compute_rays(const Camera& camera, ThreadPool& pool) {
  const size_t total = static_cast<size_t>(stride) * static_cast<size_t>(height) + kRayPack;
  for (std::vector<float>* v : {&sx, &sy, &sz, &dx, &dy, &dz, &spread}) v->resize(total);
  start = camera.rig_from_cam.translation.cast<float>();
  const Eigen::Matrix3d rotation = camera.rig_from_cam.rotation.toRotationMatrix();
  std::atomic<bool> central = true;
  pool.parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d pixel((x - margin + 0.5) / per_pixel - 0.5, (y - margin + 0.5) / per_pixel - 0.5);
      const size_t i = static_cast<size_t>(y) * stride + x;
      Ray ray;
      if (!camera.ray(pixel, &ray)) continue;
      if (!ray.origin.isZero(0)) central = false;
      const Eigen::Vector3f s = (camera.rig_from_cam * ray.origin).cast<float>();
      const Eigen::Vector3f d = (rotation * ray.direction).cast<float>();
      sx[i] = s.x(), sy[i] = s.y(), sz[i] = s.z();
      dx[i] = d.x(), dy[i] = d.y(), dz[i] = d.z();
    }
  });
  if (!central) return;
  for (std::vector<float>* v : {&sx, &sy, &sz}) *v = {};
}

// The nearer of two opposite neighbours counts: the farther one may lie beyond a seam of the image. The
// larger of row and column counts: near the pole of an equirectangular image the rays of a row are one.
void RayGrid::compute_spread(int y) {
  constexpr float kNone = 10.f;
  const auto distance = [&](size_t i, size_t k) {
    if (!sees(k)) return kNone;
    return Eigen::Vector3f(dx[i] - dx[k], dy[i] - dy[k], dz[i] - dz[k]).norm();
  };
  for (int x = 0; x < width; ++x) {
    const size_t i = static_cast<size_t>(y) * stride + x, row = static_cast<size_t>(stride);
    if (!sees(i)) continue;
    const float left = x > 0 ? distance(i, i - 1) : kNone;
    const float right = x + 1 < width ? distance(i, i + 1) : kNone;
    const float up = y > 0 ? distance(i, i - row) : kNone;
    const float down = y + 1 < height ? distance(i, i + row) : kNone;
    const float along_row = std::min(left, right), along_column = std::min(up, down);
    spread[i] = std::max(along_row == kNone ? 0.f : along_row, along_column == kNone ? 0.f : along_column);
  }
}

Renderer::Renderer(const World& world, const Camera& camera, const RenderOptions& options, ThreadPool& pool)
    : world_(world),
      options_(options),
      pool_(pool),
      width_(camera.width),
      height_(camera.height),
      grid_(camera, options.samples, pool),
      tent_(tent_weights(grid_.per_pixel)) {
  light_.resize(3 * static_cast<size_t>(grid_.stride) * static_cast<size_t>(grid_.height));
  measure_coverage();
}

void Renderer::change_lens(const Camera& camera) {
  grid_ = RayGrid(camera, options_.samples, pool_);
  measure_coverage();
}

// A pixel at the border of what the camera sees is as bright as the rays that it has: only what is behind its
// neighbours is missing to it.
void Renderer::measure_coverage() {
  const int taps = static_cast<int>(tent_.size());
  coverage_.assign(static_cast<size_t>(width_) * height_, 0.f);
  std::atomic<bool> whole = true;
  pool_.parallel_for(height_, [&](int y) {
    for (int x = 0; x < width_; ++x) {
      float sum = 0.f;
      bool all = true;
      for (int k = 0; k < taps * taps; ++k) {
        const int row = y * grid_.per_pixel + k / taps, column = x * grid_.per_pixel + k % taps;
        const bool sees = grid_.sees(static_cast<size_t>(row) * grid_.stride + column);
        all = all && sees;
        if (sees) sum += tent_[static_cast<size_t>(k / taps)] * tent_[static_cast<size_t>(k % taps)];
      }
      coverage_[static_cast<size_t>(y) * width_ + x] = all ? 1.f : sum;
      if (!all) whole = false;
    }
  });
  if (whole) coverage_ = {};
}

Image<uint8_t> Renderer::render(const Motion& world_from_rig, double time, int frame, int camera_number) {
  const int instants = options_.shutter > 0 ? std::max(options_.shutter_samples, 1) : 1;
  for (int i = 0; i < instants; ++i) {
    const double at = time + options_.shutter * ((i + 0.5) / instants - 0.5);
    expose(world_from_rig, at, i == 0, 1.f / static_cast<float>(instants));
  }
  Image<uint8_t> image(3 * width_, height_);
  const uint64_t stream = ((static_cast<uint64_t>(camera_number) << 32) + static_cast<uint64_t>(frame)) << 20;
  pool_.parallel_for(height_,
                     [&](int y) { develop_row(y, stream + static_cast<uint64_t>(y), image.row(y)); });
  return image;
}

void Renderer::expose(const Motion& world_from_rig, double time, bool first, float weight) {
  const Rigid3 middle = world_from_rig(time);
  const Scene scene(world_, time, middle.translation);
  pool_.parallel_for(grid_.height, [&](int row) {
    Rigid3 pose = middle;
    if (options_.readout > 0) {
      pose = world_from_rig(time + options_.readout * ((row + 0.5) / grid_.height - 0.5));
    }
    pose.translation -= middle.translation;
    expose_row(scene, pose, row, first, weight);
  });
}

void Renderer::expose_row(const Scene& scene, const Rigid3& scene_from_rig, int row, bool first,
                          float weight) {
  constexpr int kArrays = 10;  // start, direction, colour and distance
  const int n = grid_.stride, room = n + kRayPack;
  const size_t begin = static_cast<size_t>(row) * n;
  thread_local std::vector<float> memory;
  thread_local std::vector<int32_t> surface;
  memory.resize(static_cast<size_t>(kArrays) * room);
  surface.resize(static_cast<size_t>(room));
  float* out[kArrays];
  for (int k = 0; k < kArrays; ++k) out[k] = memory.data() + static_cast<size_t>(k) * room;

  const Eigen::Matrix3f rotation = scene_from_rig.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f shift = scene_from_rig.translation.cast<float>();
  const auto turn = [&](const std::vector<float>& xs, const std::vector<float>& ys,
                        const std::vector<float>& zs, const Eigen::Vector3f& add, float** to) {
    const float *x = &xs[begin], *y = &ys[begin], *z = &zs[begin];
    for (int k = 0; k < 3; ++k) {
      const float a = rotation(k, 0), b = rotation(k, 1), c = rotation(k, 2), e = add[k];
      for (int i = 0; i < n; ++i) to[k][i] = a * x[i] + b * y[i] + c * z[i] + e;
    }
  };
  if (grid_.sx.empty()) {
    const Eigen::Vector3f start = rotation * grid_.start + shift;
    for (int k = 0; k < 3; ++k) std::fill_n(out[k], n, start[k]);
  } else {
    turn(grid_.sx, grid_.sy, grid_.sz, shift, out);
  }
  turn(grid_.dx, grid_.dy, grid_.dz, Eigen::Vector3f::Zero(), out + 3);
  const RayRow rays{n, out[0], out[1], out[2], out[3], out[4], out[5]};
  scene.trace(rays, out[9], surface.data());
  shade(world_, scene, {rays, out[9], surface.data(), &grid_.spread[begin]}, {out[6], out[7], out[8]});
  for (int c = 0; c < 3; ++c) {
    const float* colour = out[6 + c];
    float* sum = light(c, row);
    for (int i = 0; i < n; ++i) sum[i] = weight * colour[i] + (first ? 0.f : sum[i]);
  }
}

void Renderer::develop_row(int y, uint64_t stream, uint8_t* bgr) const {
  const int taps = static_cast<int>(tent_.size()), n = grid_.stride;
  thread_local std::vector<float> columns;
  columns.assign(3 * static_cast<size_t>(n), 0.f);
  for (int c = 0; c < 3; ++c) {
    float* column = columns.data() + static_cast<size_t>(c) * n;
    for (int k = 0; k < taps; ++k) {
      const size_t plane = static_cast<size_t>(c) * grid_.height;
      const float* row = light_.data() + (plane + static_cast<size_t>(y * grid_.per_pixel + k)) * n;
      const float weight = tent_[static_cast<size_t>(k)];
      for (int i = 0; i < n; ++i) column[i] += weight * row[i];
    }
  }
  NoiseRow noise(options_.noise, options_.seed, stream);
  for (int x = 0; x < width_; ++x) {
    float sum[3] = {};
    for (int c = 0; c < 3; ++c) {
      const float* from =
          columns.data() + static_cast<size_t>(c) * n + static_cast<size_t>(x) * grid_.per_pixel;
      for (int k = 0; k < taps; ++k) sum[c] += tent_[static_cast<size_t>(k)] * from[k];
    }
    const bool dark =
        sum[0] + sum[1] + sum[2] == 0;  // where the camera sees nothing there is no noise either
    const float add = (dark ? 0.f : noise.next()) + 0.5f;
    for (int c = 0; c < 3; ++c) {
      bgr[3 * x + 2 - c] = static_cast<uint8_t>(std::min(std::max(sum[c] + add, 0.f), 255.f));
    }
  }
}

GrayImage Renderer::mask() const {
  const int n = grid_.per_pixel;
  GrayImage mask(width_, height_);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      bool all = true;
      for (int k = 0; k < n * n; ++k) {
        const int row = grid_.margin + y * n + k / n, column = grid_.margin + x * n + k % n;
        all = all && grid_.sees(static_cast<size_t>(row) * grid_.stride + column);
      }
      mask.row(y)[x] = all ? 255 : 0;
    }
  }
  return mask;
}

GrayImage to_gray(ImageView<const uint8_t> bgr) {
  GrayImage gray(bgr.width / 3, bgr.height);
  for (int y = 0; y < bgr.height; ++y) {
    const uint8_t* from = bgr.row(y);
    for (int x = 0; x < gray.width(); ++x, from += 3) {
      gray.row(y)[x] =
          static_cast<uint8_t>((from[0] * 7471 + from[1] * 38470 + from[2] * 19595 + 32768) >> 16);
    }
  }
  return gray;
}

}  // namespace raysfm::synth
