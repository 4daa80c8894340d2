#include "raysfm/exports/mesh_export.h"

#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/mesh/mesh_file.h"
#include "raysfm/mesh/mesh_surface.h"

namespace raysfm {
namespace {

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

}  // namespace

Result<void> write_mesh(const Reconstruction& world, const ExportScene& scene,
                        const std::filesystem::path& folder) {
  const SceneSurface surface = scene_surface(surface_points(mesh_scene(world, scene)));
  std::vector<std::array<uint8_t, 3>> colors;
  for (const int point : surface.mesh.points) colors.push_back(surface.space.points[point].rgb);
  return write_mesh_ply(surface.mesh, colors, "surface in the world frame of trajectory.txt", folder / "mesh.ply");
}

}  // namespace raysfm
