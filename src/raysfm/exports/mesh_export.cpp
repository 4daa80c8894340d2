#include "raysfm/exports/mesh_export.h"

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/mesh/face_views.h"
#include "raysfm/mesh/mesh_file.h"
#include "raysfm/mesh/mesh_surface.h"
#include "raysfm/mesh/mesh_texture.h"

namespace raysfm {
namespace {

constexpr const char* kMeshName = "mesh";

MeshScene mesh_scene(const Reconstruction& world, const ExportScene& scene) {
  MeshScene made;
  made.cameras = scene.cameras;
  made.skews = scene.skews;
  made.points = scene.points;
  made.error_px = world.rms_reprojection_px;
  for (const ExportImage& image : scene.images) {
    const int view = static_cast<int>(made.views.size());
    made.views.push_back({image.camera, image.world_from_cam});
    for (const ExportKeypoint& k : image.keypoints) made.sights.push_back({k.point, view, k.pixel});
  }
  return made;
}

Result<SceneSurface> make_surface(const MeshScene& scene, const MeshViews& views, ThreadPool& pool) {
  if (scene.sights.empty()) {
    return no_reconstruction(
        "the result does not tell which key frames see its points, so there is no surface");
  }
  const std::vector<SurfacePoint> points = surface_points(scene);
  const size_t known = points.size();
  if (known > 0) {
    SceneSurface surface = scene_surface(points, views, pool);
    if (!surface.mesh.faces.empty()) return surface;
  }
  return no_reconstruction(
      fmt::format("no surface: {} of {} points are seen from sides that differ enough to know where they are",
                  known, scene.points.size()));
}

std::vector<std::array<uint8_t, 3>> colors_of(const SceneSurface& surface) {
  std::vector<std::array<uint8_t, 3>> colors;
  for (const int point : surface.mesh.points) colors.push_back(surface.space.points[point].rgb);
  return colors;
}

Result<MeshTexture> paint(const Reconstruction& world, const ExportScene& scene, const MeshViews& views,
                          const SceneSurface& surface, const MeshImages& images,
                          const ExportProgress& progress, ThreadPool& pool) {
  const int total = static_cast<int>(scene.images.size());
  const std::vector<int> face_views = choose_face_views(surface, views, pool);
  TexturePainter painter(surface.mesh, face_views, views, images.texture_side);
  const Result<void> painted =
      visit_images(images.input, world, scene, [&](size_t i, const Image<uint8_t>& bgr) -> Result<void> {
        const int view = static_cast<int>(i);
        if (painter.wants(view)) painter.paint(view, bgr, pool);
        if (progress) progress("texture", view + 1, total);
        return {};
      });
  if (!painted) return painted.error();
  return painter.take();
}

}  // namespace

Result<MeshSummary> write_mesh(const Reconstruction& world, const ExportScene& scene,
                               const MeshImages& images, const std::filesystem::path& folder,
                               const ExportProgress& progress) {
  const MeshScene seen = mesh_scene(world, scene);
  if (progress) progress("surface", 0, 1);
  ThreadPool pool(thread_count(images.input.threads) - 1);
  const MeshViews views(seen);
  const Result<SceneSurface> surface = make_surface(seen, views, pool);
  if (!surface) return surface.error();
  MeshSummary summary{static_cast<int>(surface->mesh.faces.size()), {}};
  const std::string comment =
      fmt::format("surface of the map in the world frame of trajectory.txt; scale: {}",
                  world.metric_scale ? "metric, metres" : "arbitrary");
  if (auto written = write_mesh_ply(surface->mesh, colors_of(*surface), comment,
                                    folder / fmt::format("{}.ply", kMeshName));
      !written) {
    return written.error();
  }
  if (images.input.paths.empty()) {
    summary.note = "the images are not known, so there is no texture; --images tells them";
    return summary;
  }
  const Result<MeshTexture> texture = paint(world, scene, views, *surface, images, progress, pool);
  if (!texture && images.must_be_there) return texture.error();
  if (!texture) {
    summary.note = "no texture: " + texture.error().message;
    return summary;
  }
  if (auto written = write_mesh_obj(surface->mesh, *texture, comment, folder, kMeshName); !written)
    return written.error();
  return summary;
}

}  // namespace raysfm
