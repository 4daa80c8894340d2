#include "raysfm/mesh/mesh_texture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace raysfm {
namespace {

constexpr int kMargin = 2;       // texels about a patch, painted as if faces went on
constexpr int kMostSamples = 4;  // per axis of a texel

// Barycentric coordinates of a place in a triangle; false where that has no area.
bool barycentric(const std::array<Eigen::Vector2d, 3>& triangle, const Eigen::Vector2d& place,
                 Eigen::Vector3d* weights) {
  const Eigen::Vector2d a = triangle[1] - triangle[0], b = triangle[2] - triangle[0], p = place - triangle[0];
  const double area = a.x() * b.y() - a.y() * b.x();
  if (std::abs(area) < 1e-9) return false;
  const double second = (p.x() * b.y() - p.y() * b.x()) / area,
               third = (a.x() * p.y() - a.y() * p.x()) / area;
  *weights = {1 - second - third, second, third};
  return true;
}

// How far a place lies outside a triangle; texels, 0 inside.
double outside_by(const std::array<Eigen::Vector2d, 3>& triangle, const Eigen::Vector3d& weights,
                  const Eigen::Vector2d& place) {
  if (weights.minCoeff() >= -1e-9) return 0;
  double least = std::numeric_limits<double>::infinity();
  for (int e = 0; e < 3; ++e) {
    const Eigen::Vector2d edge = triangle[(e + 1) % 3] - triangle[e], to = place - triangle[e];
    const double along = std::clamp(to.dot(edge) / std::max(1e-12, edge.squaredNorm()), 0.0, 1.0);
    least = std::min(least, (to - along * edge).norm());
  }
  return least;
}

// The texels about a triangle, within a texture.
struct TexelBox {
  int left, top, right, bottom;
};
TexelBox texels_about(const std::array<Eigen::Vector2d, 3>& triangle, int width, int height) {
  Eigen::Vector2d low = triangle[0], high = triangle[0];
  for (const Eigen::Vector2d& corner : triangle) low = low.cwiseMin(corner), high = high.cwiseMax(corner);
  return {std::max(0, static_cast<int>(std::floor(low.x())) - kMargin),
          std::max(0, static_cast<int>(std::floor(low.y())) - kMargin),
          std::min(width - 1, static_cast<int>(std::ceil(high.x())) + kMargin),
          std::min(height - 1, static_cast<int>(std::ceil(high.y())) + kMargin)};
}

}  // namespace

TexturePainter::TexturePainter(const SurfaceMesh& mesh, const std::vector<int>& face_views,
                               const MeshViews& views, int most_side)
    : mesh_(mesh),
      face_views_(face_views),
      views_(views),
      patch_of_(mesh.faces.size(), -1),
      in_patch_(mesh.faces.size()),
      patches_of_view_(views.count()) {
  make_patches();
  double scale = 1;
  while (!place_all(scale, most_side)) scale *= 0.9;
}

void TexturePainter::make_patches() {
  for (size_t first = 0; first < mesh_.faces.size(); ++first) {
    if (patch_of_[first] >= 0) continue;
    const int patch = static_cast<int>(patch_faces_.size()), view = face_views_[first];
    std::vector<int> faces = {static_cast<int>(first)};
    patch_of_[first] = patch;
    for (size_t i = 0; i < faces.size(); ++i) {
      for (const int there : mesh_.beyond[faces[i]]) {
        if (there < 0 || patch_of_[there / 3] >= 0 || face_views_[there / 3] != view) continue;
        patch_of_[there / 3] = patch;
        faces.push_back(there / 3);
      }
    }
    lay_out(faces);
    patches_of_view_[view].push_back(patch);
    patch_faces_.push_back(std::move(faces));
  }
}

// As the view has them.
void TexturePainter::lay_out(const std::vector<int>& faces) {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const int f : faces) {
    for (int k = 0; k < 3; ++k) {
      // Its face was chosen because the view sees it.
      views_.pixel(face_views_[f], mesh_.positions[mesh_.faces[f][k]], &in_patch_[f][k]);
      low = low.cwiseMin(in_patch_[f][k]);
      high = high.cwiseMax(in_patch_[f][k]);
    }
  }
  for (const int f : faces) {
    for (Eigen::Vector2d& corner : in_patch_[f]) corner -= low;
  }
  patch_size_.emplace_back(high - low);
}

bool TexturePainter::place_all(double scale, int most_side) {
  std::vector<AtlasPatch> patches;
  double area = 0;
  int widest = 1;
  for (const Eigen::Vector2d& size : patch_size_) {
    AtlasPatch patch;
    patch.width = static_cast<int>(std::ceil(scale * size.x() + 2 * kMargin + 1));
    patch.height = static_cast<int>(std::ceil(scale * size.y() + 2 * kMargin + 1));
    area += static_cast<double>(patch.width) * patch.height;
    widest = std::max(widest, patch.width);
    patches.push_back(patch);
  }
  if (widest > most_side) return false;
  const int width = std::clamp(static_cast<int>(std::sqrt(1.15 * area)), widest, most_side);
  const int height = std::max(1, place_patches(width, &patches));
  if (height > most_side) return false;
  scale_ = scale;
  texture_.rgb = Image<uint8_t>(3 * width, height);
  painted_ = Image<uint8_t>(width, height);
  for (int y = 0; y < height; ++y) {
    std::memset(texture_.rgb.row(y), 128, static_cast<size_t>(3) * width);
    std::memset(painted_.row(y), 0, static_cast<size_t>(width));
  }
  texture_.places.resize(mesh_.faces.size());
  for (size_t f = 0; f < mesh_.faces.size(); ++f) {
    const AtlasPatch& patch = patches[patch_of_[f]];
    for (int k = 0; k < 3; ++k) {
      texture_.places[f][k] = scale * in_patch_[f][k] + Eigen::Vector2d(patch.x + kMargin, patch.y + kMargin);
    }
  }
  return true;
}

bool TexturePainter::sample(int view, ImageView<const uint8_t> bgr, int face, const Eigen::Vector2d& texel,
                            std::array<double, 3>* sum) const {
  Eigen::Vector3d weights;
  Eigen::Vector2d pixel;
  if (!barycentric(texture_.places[face], texel, &weights)) return false;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  for (int k = 0; k < 3; ++k) point += weights[k] * mesh_.positions[mesh_.faces[face][k]];
  if (!views_.pixel(view, point, &pixel)) return false;
  const int width = bgr.width / 3;
  const double u = std::clamp(pixel.x(), 0.0, width - 1.0), v = std::clamp(pixel.y(), 0.0, bgr.height - 1.0);
  const int left = static_cast<int>(u), top = static_cast<int>(v);
  const int right = std::min(left + 1, width - 1), bottom = std::min(top + 1, bgr.height - 1);
  const double a = u - left, b = v - top;
  for (int c = 0; c < 3; ++c) {
    const int at = 2 - c;
    const double above = (1 - a) * bgr(3 * left + at, top) + a * bgr(3 * right + at, top);
    const double below = (1 - a) * bgr(3 * left + at, bottom) + a * bgr(3 * right + at, bottom);
    (*sum)[c] += (1 - b) * above + b * below;
  }
  return true;
}

void TexturePainter::paint_face(int view, ImageView<const uint8_t> bgr, int face) {
  const auto& triangle = texture_.places[face];
  const TexelBox box = texels_about(triangle, painted_.width(), painted_.height());
  // Where a texel stands for several pixels it is their mean.
  const int samples = std::clamp(static_cast<int>(std::lround(1 / scale_)), 1, kMostSamples);
  for (int y = box.top; y <= box.bottom; ++y) {
    for (int x = box.left; x <= box.right; ++x) {
      Eigen::Vector3d weights;
      if (!barycentric(triangle, Eigen::Vector2d(x, y), &weights)) return;
      const double off = outside_by(triangle, weights, Eigen::Vector2d(x, y));
      const uint8_t rank = off == 0 ? 2 : 1;
      if (off > kMargin || painted_.row(y)[x] >= rank) continue;
      std::array<double, 3> sum = {0, 0, 0};
      int count = 0;
      for (int s = 0; s < samples * samples; ++s) {
        const Eigen::Vector2d shift((s % samples + 0.5) / samples - 0.5, (s / samples + 0.5) / samples - 0.5);
        count += sample(view, bgr, face, Eigen::Vector2d(x, y) + shift, &sum);
      }
      if (count == 0) continue;
      painted_.row(y)[x] = rank;
      for (int c = 0; c < 3; ++c)
        texture_.rgb.row(y)[3 * x + c] = static_cast<uint8_t>(std::lround(sum[c] / count));
    }
  }
}

void TexturePainter::paint(int view, ImageView<const uint8_t> bgr, ThreadPool& pool) {
  const std::vector<int>& patches = patches_of_view_[view];
  pool.parallel_for(static_cast<int>(patches.size()), [&](int i) {
    for (const int face : patch_faces_[patches[i]]) paint_face(view, bgr, face);
  });
}

MeshTexture TexturePainter::take() {
  return std::move(texture_);
}

}  // namespace raysfm
