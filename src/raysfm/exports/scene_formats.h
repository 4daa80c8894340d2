#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/exports/export_scene.h"

namespace raysfm {

// Formats of images with cameras and points. The first function of each says whether the format holds a
// camera, as it is or in a model that gives every pixel the same ray; the error is bad input, without the
// camera's name, and says what is held. The writers take scenes all of whose cameras are held.

// COLMAP 3.8 and later, in sparse/0: pixels from the corner of the first one, poses camera from world,
// quaternions w first. A rig has rig_config.json beside. Text cannot hold names with spaces, which is bad
// input.
Result<void> colmap_holds(const Camera& camera);
Result<void> write_colmap(const ExportScene& scene, bool text, const std::filesystem::path& folder);

// transforms.json of nerfstudio, and points.ply: pixels from the corner of the first one; poses world from
// camera, cameras x right, y up, z backwards; the world turned so that z, which was -y, is up
// (applied_transform). A camera for all, or one for each frame. Bad input where some cameras are fisheyes and
// some are not.
Result<void> nerfstudio_holds(const Camera& camera);
Result<void> write_nerfstudio(const ExportScene& scene, const std::filesystem::path& folder);

// Bundler v0.3, bundle.out and list.txt: pixels from the middle of the image, y up; poses camera from world,
// cameras x right, y up, z backwards; one focal length, k1 and k2.
Result<void> bundler_holds(const Camera& camera);
Result<void> write_bundler(const ExportScene& scene, const std::filesystem::path& folder);

// scene.py, which Blender runs: a scene of all frames with a pose becomes an animated camera for each of the
// rig, focal length and all, and the points. Frame n of the input is frame n + 1 there. Bad input where the
// cameras differ in size or in the shape of their pixels.
Result<void> blender_holds(const Camera& camera);
Result<void> write_blender(const Reconstruction& world, const ExportScene& scene,
                           const std::filesystem::path& folder);

}  // namespace raysfm
