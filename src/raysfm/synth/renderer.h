#pragma once

#include <cstdint>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/image/image.h"
#include "raysfm/synth/motion.h"
#include "raysfm/synth/scene.h"
#include "raysfm/worlds/world.h"

namespace raysfm::synth {

struct RenderOptions {
  int samples = 4;     // rays per pixel: 1, 4, 9 or 16, on a regular grid
  double noise = 1.5;  // standard deviation of Gaussian noise, grey levels; the same in all three channels
  double shutter = 0;  // seconds that it stays open, centred on the frame's time; 0: no motion blur
  int shutter_samples = 8;  // instants averaged while it is open
  double readout = 0;  // seconds from the first row of the image to the last, the frame's time in the middle;
                       // 0: all rows at once. People stand still meanwhile
  uint64_t seed = 0;   // of the noise
};

// Rays through a regular grid of points of the image, computed once per camera: `per_pixel` points along each
// axis of a pixel, and `margin` points more on every side. Start and direction in the rig's frame.
struct RayGrid {
  int per_pixel = 0, margin = 0;
  int width = 0, height = 0;  // points
  int stride = 0;  // points per row in memory, a multiple of kRayPack; behind `width` rays are zero
  std::vector<float> dx, dy, dz;  // zero where the camera sees nothing
  std::vector<float> sx, sy, sz;  // empty where all rays start at `start`
  Eigen::Vector3f start = Eigen::Vector3f::Zero();
  std::vector<float> spread;  // radians to the neighbours of a ray along rows or columns, the larger

  RayGrid(const Camera& camera, int samples, ThreadPool& pool);
  bool sees(size_t point) const { return dx[point] != 0 || dy[point] != 0 || dz[point] != 0; }

 private:
  void compute_rays(const Camera& camera, ThreadPool& pool);
  void compute_spread(int y);
};

// Largest number of grid points of a camera; more is refused before anything is allocated.
constexpr int64_t kMaxGridPoints = int64_t{1} << 27;
bool fits_in_memory(const Camera& camera, int samples);

// Images of a world through one camera. Light falls on a pixel through a tent two pixels wide, as a lens and
// a sensor blur together: images hold no frequencies that the pixel grid cannot carry.
class Renderer {
 public:
  // `world` and `pool` must outlive it. fits_in_memory(camera, options.samples) must hold.
  Renderer(const World& world, const Camera& camera, const RenderOptions& options, ThreadPool& pool);

  // From now on renders through another camera of the same resolution.
  void change_lens(const Camera& camera);

  // Image at `time` (seconds), blue, green, red interleaved: width 3 * camera width. `frame` and
  // `camera_number` choose the noise. Bit-identical for any number of threads.
  Image<uint8_t> render(const Motion& world_from_rig, double time, int frame, int camera_number = 0);

  // 255 where all rays through a pixel see the world, 0 where some or all see nothing.
  GrayImage mask() const;

 private:
  void expose(const Motion& world_from_rig, double time, bool first, float weight);
  void expose_row(const Scene& scene, const Rigid3& scene_from_rig, int row, bool first, float weight);
  void measure_coverage();
  void develop_row(int y, uint64_t stream, uint8_t* bgr) const;
  float* light(int channel, int row) {
    return light_.data() + (static_cast<size_t>(channel) * grid_.height + row) * grid_.stride;
  }

  const World& world_;
  RenderOptions options_;
  ThreadPool& pool_;
  int width_, height_;
  RayGrid grid_;
  std::vector<float> light_;  // of each grid point, a plane of red, one of green and one of blue
  std::vector<float> tent_;   // weights of the grid points of one pixel along one axis
  // Weight of the rays of each pixel that see the world; empty where all do.
  std::vector<float> coverage_;
};

// Grey image of an interleaved blue, green, red one, with the weights of ITU-R BT.601.
GrayImage to_gray(ImageView<const uint8_t> bgr);

}  // namespace raysfm::synth
