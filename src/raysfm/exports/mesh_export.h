#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/exports/export.h"
#include "raysfm/exports/export_scene.h"
#include "raysfm/exports/scene_images.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What a mesh is painted with.
struct MeshImages {
  ImageInput input;            // without paths: no texture
  int texture_side = 4096;     // most texels along a side
  bool must_be_there = false;  // or else a mesh without texture will do
};

// What became of it.
struct MeshSummary {
  int faces = 0;
  std::string note;  // one line, empty: nothing to say
};

// Writes the surface of a world by its map: mesh.ply with the colours of the points, and where there are
// images mesh.obj, mesh.mtl and mesh.jpg. Errors: no reconstruction where the map tells no surface; those of
// the images where they must be there.
Result<MeshSummary> write_mesh(const Reconstruction& world, const ExportScene& scene,
                               const MeshImages& images, const std::filesystem::path& folder,
                               const ExportProgress& progress);

}  // namespace raysfm
