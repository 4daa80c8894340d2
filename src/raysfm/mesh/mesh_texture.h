#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/image/image.h"
#include "raysfm/mesh/atlas.h"
#include "raysfm/mesh/mesh_surface.h"
#include "raysfm/mesh/mesh_views.h"

namespace raysfm {

// One image for all faces of a mesh.
struct MeshTexture {
  Image<uint8_t> rgb;  // red, green, blue side by side: three times as wide as the texture
  // By face and corner: where it is, texels, the centre of the first at (0, 0).
  std::vector<std::array<Eigen::Vector2d, 3>> places;
};

// Paints the texture of a mesh from images. Faces side by side that have one view become a patch that has
// about the texels of that view's pixels. A texel shows what the view has at the point of the face that it
// stands for, found by the camera's own projection: no bend of a lens is left.
class TexturePainter {
 public:
  // `face_views`: as choose_face_views() has them, none of them -1. `most_side`: of the texture, texels; at
  // least 64. All must outlive it.
  TexturePainter(const SurfaceMesh& mesh, const std::vector<int>& face_views, const MeshViews& views,
                 int most_side);

  // Whether a face has this view.
  bool wants(int view) const { return !patches_of_view_[view].empty(); }
  // Paints all faces of a view from its image: blue, green, red side by side, of the size of its camera.
  // Bit-identical for any number of threads.
  void paint(int view, ImageView<const uint8_t> bgr, ThreadPool& pool);
  // The texture, once all views are painted.
  MeshTexture take();

 private:
  void make_patches();
  void lay_out(const std::vector<int>& faces);
  bool place_all(double scale, int most_side);
  void paint_face(int view, ImageView<const uint8_t> bgr, int face);
  bool sample(int view, ImageView<const uint8_t> bgr, int face, const Eigen::Vector2d& texel,
              std::array<double, 3>* sum) const;

  const SurfaceMesh& mesh_;
  const std::vector<int>& face_views_;
  const MeshViews& views_;
  std::vector<std::vector<int>> patch_faces_;
  std::vector<int> patch_of_;  // by face
  std::vector<std::array<Eigen::Vector2d, 3>>
      in_patch_;                                   // by face and corner: pixels from the patch's corner
  std::vector<Eigen::Vector2d> patch_size_;        // pixels
  std::vector<std::vector<int>> patches_of_view_;  // by view: its patches
  double scale_ = 1;                               // texels per pixel
  MeshTexture texture_;
  Image<uint8_t> painted_;  // by texel: 0 nothing, 1 beside a face, 2 in one
};

}  // namespace raysfm
