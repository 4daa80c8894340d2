#include "raysfm/camera/fit_ray_table.h"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/models/cubic_weights.h"

namespace raysfm {
namespace {

constexpr int kPerCell = 4;  // samples along each side of a cell
constexpr int kReach = 3;    // control points that share a cell are at most this far apart
constexpr int kStencil = 2 * kReach + 1;

// Normal equations of the control points, of six coordinates at once (direction, origin), stored as the
// couplings of every control point with its neighbours.
class SplineFit {
 public:
  SplineFit(int width, int height)
      : width_(width),
        height_(height),
        used_(static_cast<size_t>(width) * height, 0),
        couplings_(used_.size() * kStencil * kStencil, 0.0),
        right_(Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(used_.size()), 6)) {}

  // A value at the fraction (tx, ty) of the cell whose first control point is (column, row).
  void add(int column, int row, double tx, double ty, const Eigen::Matrix<double, 6, 1>& value) {
    const CubicWeights wx(tx), wy(ty);
    for (int a = 0; a < 16; ++a) {
      const int node = index(column + a % 4, row + a / 4);
      const double weight = wx.value[a % 4] * wy.value[a / 4];
      used_[node] = 1;
      right_.row(node) += weight * value.transpose();
      for (int b = 0; b < 16; ++b) {
        couple(node, b % 4 - a % 4, b / 4 - a / 4, weight * wx.value[b % 4] * wy.value[b / 4]);
      }
    }
  }

  // The control points, one row each; not finite where no value was near. False when the equations are
  // singular.
  bool solve(Eigen::MatrixXd* control) {
    // Where values are few, the spline continues straight on; far below what values say where they are many.
    constexpr double kBending = 1e-7, kSize = 1e-13;
    for (int row = 0; row < height_; ++row) {
      for (int column = 0; column < width_; ++column) {
        couple(index(column, row), 0, 0, kSize);
        bend(column, row, 1, 0, kBending);
        bend(column, row, 0, 1, kBending);
      }
    }
    Eigen::SparseMatrix<double> normal = matrix();
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factors(normal);
    if (factors.info() != Eigen::Success) return false;
    *control = factors.solve(right_);
    for (size_t i = 0; i < used_.size(); ++i) {
      if (!used_[i])
        control->row(static_cast<Eigen::Index>(i)).setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    return true;
  }

 private:
  int index(int column, int row) const { return row * width_ + column; }

  double& coupling(int node, int dx, int dy) {
    return couplings_[(static_cast<size_t>(node) * kStencil + (dy + kReach)) * kStencil + dx + kReach];
  }
  void couple(int node, int dx, int dy, double weight) { coupling(node, dx, dy) += weight; }

  // Adds weight (p[-1] - 2 p[0] + p[1])^2 along an axis around a control point.
  void bend(int column, int row, int dx, int dy, double weight) {
    if (column < dx || row < dy || column + dx >= width_ || row + dy >= height_) return;
    constexpr double kSecond[3] = {1, -2, 1};
    for (int a = -1; a <= 1; ++a) {
      const int node = index(column + a * dx, row + a * dy);
      for (int b = -1; b <= 1; ++b) {
        couple(node, (b - a) * dx, (b - a) * dy, weight * kSecond[a + 1] * kSecond[b + 1]);
      }
    }
  }

  Eigen::SparseMatrix<double> matrix() {
    std::vector<Eigen::Triplet<double>> entries;
    for (int node = 0; node < static_cast<int>(used_.size()); ++node) {
      for (int dy = -kReach; dy <= 0; ++dy) {
        for (int dx = -kReach; dx <= kReach; ++dx) {
          const double value = coupling(node, dx, dy);
          const int other = node + dy * width_ + dx;
          if (value != 0 && other <= node) entries.emplace_back(node, other, value);
        }
      }
    }
    Eigen::SparseMatrix<double> lower(static_cast<Eigen::Index>(used_.size()),
                                      static_cast<Eigen::Index>(used_.size()));
    lower.setFromTriplets(entries.begin(), entries.end());
    return lower;
  }

  int width_, height_;
  std::vector<uint8_t> used_;
  std::vector<double> couplings_;
  Eigen::MatrixXd right_;
};

// Calls visit(column, row, tx, ty, pixel) for the sub-pixel positions of every cell; `offset` in [0, 1) of
// their distance.
template <typename Visit>
void for_each_sample(const RayGridData& grid, double offset, Visit visit) {
  const double cell_width = (grid.max_x + 1.0 - grid.min_x) / (grid.grid_width - 3);
  const double cell_height = (grid.max_y + 1.0 - grid.min_y) / (grid.grid_height - 3);
  for (int row = 0; row + 3 < grid.grid_height; ++row) {
    for (int column = 0; column + 3 < grid.grid_width; ++column) {
      for (int i = 0; i < kPerCell * kPerCell; ++i) {
        const double tx = (i % kPerCell + offset) / kPerCell, ty = (i / kPerCell + offset) / kPerCell;
        visit(column, row, tx, ty,
              Eigen::Vector2d(grid.min_x - 0.5 + (column + tx) * cell_width,
                              grid.min_y - 0.5 + (row + ty) * cell_height));
      }
    }
  }
}

// Angle between the two cameras' rays at positions that were not fitted.
void compare(const Camera& wanted, const RayGridData& grid, RayFit* fit) {
  double sum = 0;
  Camera in_own_frame = wanted;
  in_own_frame.rig_from_cam = Rigid3{};
  for_each_sample(grid, 0.0, [&](int, int, double, double, const Eigen::Vector2d& pixel) {
    ObservedRay observed;
    Ray ray;
    Eigen::Vector2d error;
    if (!observe_ray(in_own_frame, pixel, AngularWeight::kPixel, &observed) ||
        !fit->camera.ray(pixel, &ray) || !observed.residual(observed.origin + ray.direction, &error)) {
      return;
    }
    ++fit->samples;
    sum += error.squaredNorm();
    fit->max_px = std::max(fit->max_px, error.norm());
    fit->max_origin =
        std::max(fit->max_origin, observed.direction.cross(ray.origin - observed.origin).norm());
  });
  if (fit->samples > 0) fit->rms_px = std::sqrt(sum / fit->samples);
}

int default_size(int pixels) {
  return 3 + std::clamp(pixels / 16, 4, 80);
}

}  // namespace

Result<RayFit> fit_ray_table(const Camera& camera, int grid_width, int grid_height) {
  constexpr int kMaxSide = 1024;
  if (camera.width < 1 || camera.height < 1) {
    return bad_input("resolution " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                     ": at least 1 x 1");
  }
  RayGridData grid;
  grid.max_x = camera.width - 1;
  grid.max_y = camera.height - 1;
  grid.grid_width = grid_width > 0 ? grid_width : default_size(camera.width);
  grid.grid_height = grid_height > 0 ? grid_height : default_size(camera.height);
  for (const int side : {grid.grid_width, grid.grid_height}) {
    if (side < 4 || side > kMaxSide) return bad_input("grid size " + std::to_string(side) + ": 4 to 1024");
  }
  SplineFit spline(grid.grid_width, grid.grid_height);
  int seen = 0;
  for_each_sample(grid, 0.5, [&](int column, int row, double tx, double ty, const Eigen::Vector2d& pixel) {
    Ray ray;
    if (!camera.ray(pixel, &ray)) return;
    ++seen;
    Eigen::Matrix<double, 6, 1> value;
    value << ray.direction, ray.origin;
    spline.add(column, row, tx, ty, value);
  });
  if (seen == 0) return bad_input("camera " + camera.name + ": no pixel sees anything, a camera with rays");
  Eigen::MatrixXd control;
  if (!spline.solve(&control)) return internal_error("the equations of the ray table are singular");
  const bool central =
      std::visit([](const auto& m) { return CentralModel<std::decay_t<decltype(m)>>; }, camera.model);
  for (Eigen::Index i = 0; i < control.rows(); ++i) {
    grid.directions.emplace_back(control.row(i).head<3>());
    if (!central) grid.points.emplace_back(control.row(i).tail<3>());
  }
  RayFit fit;
  fit.camera = camera;
  if (central) {
    fit.camera.model = CentralRayTable(grid);
  } else {
    fit.camera.model = NonCentralRayTable(grid);
  }
  compare(camera, grid, &fit);
  return fit;
}

}  // namespace raysfm
