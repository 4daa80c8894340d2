// A table fitted to a camera, a model fitted to a table.

#include <gtest/gtest.h>

#include "raysfm/camera/fit_model.h"
#include "raysfm/camera/fit_ray_table.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/camera/pixel_finder.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixture_camera;
using testing_support::fixtures;

// Angle between the rays of two cameras over the pixels of a grid that both see, and what only the first
// sees.
struct Difference {
  double max_angle = 0, max_origin = 0;
  int compared = 0, only_first = 0;
};

Difference difference(const Camera& a, const Camera& b) {
  Difference d;
  for (double v = 0; v < a.height; v += 7) {
    for (double u = 0; u < a.width; u += 7) {
      Ray ray_a, ray_b;
      if (!a.ray({u, v}, &ray_a)) continue;
      if (!b.ray({u, v}, &ray_b)) {
        ++d.only_first;
        continue;
      }
      ++d.compared;
      d.max_angle = std::max(d.max_angle, ray_a.direction.cross(ray_b.direction).norm());
      d.max_origin = std::max(d.max_origin, (ray_a.origin - ray_b.origin).norm());
    }
  }
  return d;
}

TEST(FitRayTable, StandsForAFisheye) {
  const Camera fisheye = fixture_camera(fixtures<KannalaBrandt>()[0]);
  const auto fit = fit_ray_table(fisheye);
  ASSERT_TRUE(fit.ok());
  ASSERT_TRUE(std::holds_alternative<CentralRayTable>(fit->camera.model));
  EXPECT_LT(fit->max_px, 1e-3);
  EXPECT_GT(fit->samples, 15000);
  const Difference d = difference(fisheye, fit->camera);
  EXPECT_LT(d.max_angle, 1e-3 / 276);
  EXPECT_EQ(d.only_first, 0);
  // Half the cells in each direction: an error of the fourth order is some sixteen times as large.
  const auto coarse = fit_ray_table(fisheye, 23, 18);
  ASSERT_TRUE(coarse.ok());
  EXPECT_GT(coarse->rms_px, 8 * fit->rms_px);
  EXPECT_LT(coarse->rms_px, 40 * fit->rms_px);
}

TEST(FitRayTable, StandsForAMirror) {
  const Camera mirror = fixture_camera(fixtures<Mirror>()[0]);
  const auto fit = fit_ray_table(mirror);
  ASSERT_TRUE(fit.ok());
  ASSERT_TRUE(std::holds_alternative<NonCentralRayTable>(fit->camera.model));
  const Difference d = difference(mirror, fit->camera);
  EXPECT_EQ(d.only_first, 0);
  EXPECT_GT(d.compared, 2000);
  EXPECT_LT(fit->rms_px, 0.01);
  EXPECT_LT(d.max_origin, 1e-4);
  Ray ray;
  EXPECT_FALSE(fit->camera.ray({0, 0}, &ray));
}

TEST(FitRayTable, RefusesWhatItCannot) {
  Camera camera = fixture_camera(fixtures<Pinhole>()[0]);
  EXPECT_FALSE(fit_ray_table(camera, 3, 10).ok());
  EXPECT_FALSE(fit_ray_table(camera, 10, 5000).ok());
  EXPECT_FALSE(fit_ray_table(fixture_camera(CentralRayTable())).ok());
  camera.width = 0;
  EXPECT_FALSE(fit_ray_table(camera).ok());
}

TEST(PixelFinder, LeadsBackToThePixelOfATable) {
  for (const Camera& original :
       {fixture_camera(fixtures<KannalaBrandt>()[1]), fixture_camera(fixtures<Mirror>()[1]),
        fixture_camera(fixtures<Equirectangular>()[0])}) {
    const auto fit = fit_ray_table(original);
    ASSERT_TRUE(fit.ok());
    const PixelFinder finder(fit->camera);
    int tried = 0;
    for (double v = 1; v < 479; v += 11.3) {
      for (double u = 1; u < 639; u += 9.7) {
        Ray ray;
        Eigen::Vector2d pixel;
        if (!original.ray({u, v}, &ray) || !fit->camera.ray({u, v}, &ray)) continue;
        ++tried;
        ASSERT_TRUE(finder.find(ray.origin + 3 * ray.direction, &pixel)) << u << ' ' << v;
        EXPECT_LT((pixel - Eigen::Vector2d(u, v)).norm(), 1e-6) << u << ' ' << v;
      }
    }
    EXPECT_GT(tried, 500);
  }
}

// A model through its own table: the same numbers again.
template <typename Model>
void expect_recovered(const Model& model, double relative) {
  const auto table = fit_ray_table(fixture_camera(model));
  ASSERT_TRUE(table.ok());
  const auto fit = fit_model(table->camera, Model::kName);
  ASSERT_TRUE(fit.ok()) << fit.error().message;
  EXPECT_LT(fit->rms_px, 0.02) << Model::kName;
  const auto found = std::get<Model>(fit->camera.model).parameters(), expected = model.parameters();
  for (size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found[i], expected[i], relative * (std::abs(expected[i]) + 0.1))
        << Model::kName << ' ' << Model::kParameterNames[i];
  }
}

TEST(FitModel, FindsTheModelBehindATable) {
  expect_recovered(fixtures<Pinhole>()[0], 1e-6);
  expect_recovered(fixtures<Radtan>()[1], 1e-3);
  expect_recovered(fixtures<KannalaBrandt>()[0], 1e-3);
  expect_recovered(fixtures<DoubleSphere>()[1], 1e-3);
  expect_recovered(fixtures<Eucm>()[1], 1e-3);
  expect_recovered(fixtures<OCam>()[0], 1e-3);
  expect_recovered(fixtures<Unified>()[0], 1e-3);
}

TEST(FitModel, SaysHowFarAnotherModelIsOff) {
  // EuRoC's camera by two calibrations: a model of six numbers comes within a pixel of one of eight.
  const Camera radtan = fixture_camera(fixtures<Radtan>()[1]);
  const auto close = fit_model(radtan, "double-sphere");
  ASSERT_TRUE(close.ok());
  EXPECT_LT(close->rms_px, 1);
  const auto far = fit_model(radtan, "pinhole");
  ASSERT_TRUE(far.ok());
  EXPECT_GT(far->rms_px, 3);
  EXPECT_EQ(far->samples, close->samples);
  // The residual is that of the cameras' pixels.
  double max_px = 0;
  for (double v = 0; v < 480; v += 10) {
    for (double u = 0; u < 640; u += 10) {
      Ray ray;
      Eigen::Vector2d pixel;
      ASSERT_TRUE(radtan.ray({u, v}, &ray) && close->camera.project(ray.direction, &pixel));
      max_px = std::max(max_px, (pixel - Eigen::Vector2d(u, v)).norm());
    }
  }
  EXPECT_NEAR(close->max_px, max_px, 0.3 * max_px);
}

TEST(FitModel, KeepsAWideFieldOutOfAPerspectiveModel) {
  const Camera fisheye = fixture_camera(fixtures<KannalaBrandt>()[2]);
  const auto wide = fit_model(fisheye, "kannala-brandt"), narrow = fit_model(fisheye, "radtan");
  ASSERT_TRUE(wide.ok() && narrow.ok());
  EXPECT_LT(wide->rms_px, 1e-6);
  EXPECT_LT(narrow->samples, 0.5 * wide->samples);
  EXPECT_FALSE(find_problem(narrow->camera.model));
}

TEST(FitModel, RefusesWhatItCannot) {
  EXPECT_FALSE(fit_model(fixture_camera(fixtures<Mirror>()[0]), "kannala-brandt").ok());
  EXPECT_FALSE(fit_model(fixture_camera(fixtures<Pinhole>()[0]), "mirror").ok());
  EXPECT_FALSE(fit_model(fixture_camera(fixtures<Pinhole>()[0]), "nonsense").ok());
  EXPECT_FALSE(fit_model(fixture_camera(CentralRayTable()), "pinhole").ok());
  const auto table = fit_model(fixture_camera(fixtures<Mirror>()[0]), "ray-table");
  ASSERT_TRUE(table.ok());
  EXPECT_TRUE(std::holds_alternative<NonCentralRayTable>(table->camera.model));
}

}  // namespace
}  // namespace raysfm
