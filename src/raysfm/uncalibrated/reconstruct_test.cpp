#include "raysfm/uncalibrated/reconstruct.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "raysfm/core/timer.h"
#include "raysfm/uncalibrated/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;

TEST(Probe, Reconstruct) {
  for (const bool zoom : {false, true})
    for (double noise : {0.0, 0.5})
      for (double outliers : {0.0, 0.15})
        for (int t = 0; t < 4; ++t) {
          Rng rng(100 + t);
          Cube cube =
              make_cube({.images = 8, .points = 60, .zooming = zoom, .principal_point_spread = 5}, &rng);
          add_noise(noise, &rng, &cube.tracks);
          for (auto& p : cube.tracks.pixel)
            if (rng.uniform() < outliers) p += Eigen::Vector2d(rng.uniform(-50, 50), rng.uniform(-50, 50));
          const auto t0 = Clock::now();
          auto r = reconstruct(cube.tracks, {});
          printf("zoom %d noise %.1f out %.2f: ", zoom, noise, outliers);
          if (!r) {
            printf("FAIL %s\n", r.error().message.c_str());
            continue;
          }
          double fe = 0, fs = 0;
          int posed = 0, in = 0;
          for (int j = 0; j < 8; ++j)
            if (r->image_posed[j])
              ++posed, fe += std::abs(r->scene.lenses[j].fx / cube.truth.lenses[j].fx - 1) / 8,
                  fs += r->lens_sigma[j][0] / 1000 / 8;
          for (auto i : r->inlier) in += i;
          std::vector<Eigen::Vector3d> a, b;
          for (int i = 0; i < 60; ++i)
            if (r->point_placed[i]) a.push_back(r->scene.points[i]), b.push_back(cube.truth.points[i]);
          printf(
              "zooming %d posed %d placed %zu inliers %d f %.2e (sigma %.2e) err %.2e rms %.3f it %d pair "
              "%d-%d %.1f ms '%s'\n",
              r->zooming, posed, a.size(), in, fe, fs, test_scenes::structure_error(a, b), r->rms_px,
              r->adjustment.lm.iterations, r->start_images[0], r->start_images[1], milliseconds_since(t0),
              r->degenerate.c_str());
        }
}

}  // namespace
}  // namespace raysfm
