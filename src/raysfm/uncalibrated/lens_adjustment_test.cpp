#include "raysfm/uncalibrated/lens_adjustment.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "raysfm/core/timer.h"
#include "raysfm/uncalibrated/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::perturbed;

TEST(Probe, Probe) {
  for (const bool zoom : {false, true})
    for (int images : {4, 6, 10})
      for (double noise : {0.0, 1.0, 3.0}) {
        double it[3] = {}, ms[3] = {}, err[3] = {}, fe[3] = {}, cost[3] = {};
        const int trials = 20;
        for (int t = 0; t < trials; ++t) {
          Rng rng(100 + t);
          Cube cube = make_cube({.images = images, .zooming = zoom, .principal_point_spread = 10}, &rng);
          add_noise(noise, &rng, &cube.tracks);
          const UncalibratedScene start = perturbed(cube.truth, 0.03, &rng);
          LensAdjustmentOptions o;
          o.constraints.equal = !zoom;
          o.constraints.zero_skew = o.constraints.unit_aspect = true;
          o.with_sigma = false;
          const char* w = getenv("CW");
          if (w) o.constraint_weight = atof(w);
          if (getenv("LAG")) o.method = ConstraintMethod::kLagrange;
          for (int m = 0; m < 3; ++m) {
            UncalibratedScene s = start;
            const auto t0 = Clock::now();
            auto r = m == 0   ? adjust_standard(cube.tracks, {}, o, &s)
                     : m == 1 ? adjust_intrinsics_free(cube.tracks, {}, o, &s)
                              : adjust_polished(cube.tracks, {}, o, &s);
            ms[m] += milliseconds_since(t0) / trials;
            ASSERT_TRUE(r.ok()) << r.error().message;
            it[m] += r->lm.iterations / double(trials);
            cost[m] += r->lm.final_cost / trials;
            err[m] += test_scenes::structure_error(s.points, cube.truth.points) / trials;
            for (int j = 0; j < images; ++j)
              fe[m] += std::abs(s.lenses[j].fx / cube.truth.lenses[j].fx - 1) / trials / images;
          }
        }
        printf("%s m=%d noise %.0f:", zoom ? "zoom " : "fixed", images, noise);
        for (int m = 0; m < 3; ++m)
          printf(" | it %5.1f ms %6.2f err %.2e f %.1e cost %.4g", it[m], ms[m], err[m], fe[m], cost[m]);
        printf("\n");
      }
}

}  // namespace
}  // namespace raysfm
