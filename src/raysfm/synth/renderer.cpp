#include "raysfm/synth/renderer.h"

#include <algorithm>
#include <cassert>
#include <cmath>

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
  const size_t total = static_cast<size_t>(stride) * static_cast<size_t>(height);
  for (std::vector<float>* v : {&sx, &sy, &sz, &dx, &dy, &dz, &spread}) v->resize(total);
  const Eigen::Matrix3d rotation = camera.rig_from_cam.rotation.toRotationMatrix();
  pool.parallel_for(height, [&](int y) {
    float usual = 0.f;
    Eigen::Vector3f last = Eigen::Vector3f::Zero();
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d pixel((x - margin + 0.5) / per_pixel - 0.5, (y - margin + 0.5) / per_pixel - 0.5);
      const size_t i = static_cast<size_t>(y) * stride + x;
      Ray ray;
      if (!camera.ray(pixel, &ray)) {
        last.setZero();
        continue;
      }
      const Eigen::Vector3f s = (camera.rig_from_cam * ray.origin).cast<float>();
      const Eigen::Vector3f d = (rotation * ray.direction).cast<float>();
      if (!last.isZero()) usual = (d - last).norm();
      last = d;
      sx[i] = s.x(), sy[i] = s.y(), sz[i] = s.z();
      dx[i] = d.x(), dy[i] = d.y(), dz[i] = d.z();
      spread[i] = usual;
    }
  });
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
}

Image<uint8_t> Renderer::render(const Motion& world_from_rig, double time, int frame, int camera_number) {
  const int instants = options_.shutter > 0 ? std::max(options_.shutter_samples, 1) : 1;
  std::fill(light_.begin(), light_.end(), 0.f);
  for (int i = 0; i < instants; ++i) {
    const double at = time + options_.shutter * ((i + 0.5) / instants - 0.5);
    expose(world_from_rig(at), at, 1.f / static_cast<float>(instants));
  }
  Image<uint8_t> image(3 * width_, height_);
  const uint64_t stream = ((static_cast<uint64_t>(camera_number) << 32) + static_cast<uint64_t>(frame)) << 20;
  pool_.parallel_for(height_,
                     [&](int y) { develop_row(y, stream + static_cast<uint64_t>(y), image.row(y)); });
  return image;
}

void Renderer::expose(const Rigid3& world_from_rig, double time, float weight) {
  const Scene scene(world_, time, world_from_rig.translation);
  const Eigen::Matrix3f rotation = world_from_rig.rotation.toRotationMatrix().cast<float>();
  pool_.parallel_for(grid_.height, [&](int row) { expose_row(scene, rotation, row, weight); });
}

void Renderer::expose_row(const Scene& scene, const Eigen::Matrix3f& world_from_rig, int row, float weight) {
  const int n = grid_.stride;
  const size_t first = static_cast<size_t>(row) * n;
  thread_local std::vector<float> memory;
  thread_local std::vector<int32_t> surface;
  memory.resize(7 * static_cast<size_t>(n));
  surface.resize(static_cast<size_t>(n));
  float* out[7];
  for (int k = 0; k < 7; ++k) out[k] = memory.data() + static_cast<size_t>(k) * n;
  const float* in[6] = {&grid_.sx[first], &grid_.sy[first], &grid_.sz[first],
                        &grid_.dx[first], &grid_.dy[first], &grid_.dz[first]};
  for (int k = 0; k < 6; ++k) {
    const float a = world_from_rig(k % 3, 0), b = world_from_rig(k % 3, 1), c = world_from_rig(k % 3, 2);
    const float *x = in[k / 3 * 3], *y = in[k / 3 * 3 + 1], *z = in[k / 3 * 3 + 2];
    for (int i = 0; i < n; ++i) out[k][i] = a * x[i] + b * y[i] + c * z[i];
  }
  float* distance = out[6];
  scene.trace({n, out[0], out[1], out[2], out[3], out[4], out[5]}, distance, surface.data());

  float* light = light_.data() + 3 * first;
  for (int i = 0; i < grid_.width; ++i) {
    const Eigen::Vector3f direction(out[3][i], out[4][i], out[5][i]);
    if (direction.isZero()) continue;  // outside the valid set of the camera: stays black
    const Sight sight{
        {out[0][i], out[1][i], out[2][i]}, direction, distance[i], surface[i], grid_.spread[first + i]};
    const Colour colour = shade(world_, scene, sight);
    for (int c = 0; c < 3; ++c) light[3 * i + c] += weight * colour[c];
  }
}

void Renderer::develop_row(int y, uint64_t stream, uint8_t* bgr) const {
  const int taps = static_cast<int>(tent_.size()), n = 3 * grid_.width;
  thread_local std::vector<float> column;
  column.assign(static_cast<size_t>(n), 0.f);
  for (int k = 0; k < taps; ++k) {
    const float* row = light_.data() + 3 * static_cast<size_t>(y * grid_.per_pixel + k) * grid_.stride;
    for (int i = 0; i < n; ++i) column[static_cast<size_t>(i)] += tent_[static_cast<size_t>(k)] * row[i];
  }
  Rng rng(options_.seed, stream);
  for (int x = 0; x < width_; ++x) {
    Colour sum = Colour::Zero();
    const float* from = column.data() + 3 * static_cast<size_t>(x) * grid_.per_pixel;
    for (int k = 0; k < taps; ++k)
      sum += tent_[static_cast<size_t>(k)] * Eigen::Map<const Colour>(from + 3 * k);
    if (options_.noise > 0) sum += static_cast<float>(options_.noise * rng.normal());
    sum = (sum + 0.5f).max(0.f).min(255.f);
    for (int c = 0; c < 3; ++c) bgr[3 * x + c] = static_cast<uint8_t>(sum[2 - c]);
  }
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
