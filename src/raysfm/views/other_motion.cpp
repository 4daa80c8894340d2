#include "raysfm/views/other_motion.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

// Cells of an image are square, and have so many corners in the mean; as many across as these numbers allow.
constexpr double kCornersInMean = 7;
constexpr int kFewestAcross = 4, kMostAcross = 16;
// A cell with fewer corners says nothing. One is unexplained where less than this part of its corners is.
constexpr int kCornersOfCell = 4, kCellsOfImage = 20;
constexpr double kExplained = 0.25;
// Mean over three key frames above which there is something to say. Real and rendered footage that is tracked
// well has 0.01 to 0.21, kitti00-small up to 0.32; paths that are those of an overlay have 0.25 to 0.65
// (docs/results/hard.md).
constexpr double kMuch = 0.23;
constexpr size_t kTogether = 3;

// It agrees with a point, or was found where the geometry of two key frames lets it be.
bool is_explained(const Map& map, const MapKeyFrame& keyframe, int feature) {
  const int track = keyframe.tracks[feature];
  if (track < 0) return false;
  const Track& t = map.tracks[track];
  return (t.triangulated && keyframe.inliers[feature]) || t.observations.size() > 1;
}

// The images of a rig, divided into cells.
class Cells {
 public:
  struct Cell {
    int corners = 0, explained = 0;
    int camera = 0;
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  // sum over the corners
  };

  Cells(const TrackingRig& rig, const MapKeyFrame& keyframe) {
    std::vector<int> corners(rig.size(), 0);
    for (const uint8_t camera : keyframe.cameras) ++corners[camera];
    for (int c = 0; c < rig.size(); ++c) {
      const Camera& camera = rig.camera(c);
      const double wanted = std::sqrt(corners[c] * double(camera.width) / (kCornersInMean * camera.height));
      Grid grid{cells_.size(), std::clamp(static_cast<int>(std::lround(wanted)), kFewestAcross, kMostAcross)};
      grid.side = static_cast<float>(camera.width) / static_cast<float>(grid.columns);
      grid.rows = static_cast<int>(static_cast<float>(camera.height) / grid.side) + 1;
      cells_.resize(cells_.size() + static_cast<size_t>(grid.columns) * grid.rows);
      grids_.push_back(grid);
    }
  }

  Cell& at(int camera, const Eigen::Vector2f& pixel) {
    const Grid& grid = grids_[camera];
    const auto cell_of = [&](float x, int cells) {
      return std::clamp(static_cast<int>(std::floor(x / grid.side)), 0, cells - 1);
    };
    return cells_[grid.first + static_cast<size_t>(cell_of(pixel.y(), grid.rows)) * grid.columns +
                  cell_of(pixel.x(), grid.columns)];
  }
  const std::vector<Cell>& all() const { return cells_; }

 private:
  struct Grid {
    size_t first = 0;
    int columns = 0, rows = 0;
    float side = 0;  // pixels
  };
  std::vector<Cell> cells_;
  std::vector<Grid> grids_;  // by camera
};

// Whether what is far away at a pixel of a camera is still seen by a rig that turned so.
bool stays_in_sight(const TrackingRig& rig, int camera, const Eigen::Vector2d& pixel,
                    const Eigen::Quaterniond& to_from_rig) {
  constexpr double kFarAway = 1e4;
  Ray ray;
  if (!rig.camera(camera).ray(pixel, &ray)) return true;
  const Eigen::Vector3d direction = to_from_rig * (rig.camera(camera).rig_from_cam.rotation * ray.direction);
  for (int c = 0; c < rig.size(); ++c) {
    Eigen::Vector2d at;
    if (rig.see(c, rig.cam_from_rig(c) * (kFarAway * direction), &at)) return true;
  }
  return false;
}

}  // namespace

std::optional<double> unexplained_part(const Map& map, int number, const TrackingRig& rig) {
  const MapKeyFrame& keyframe = map.keyframes[number];
  Cells cells(rig, keyframe);
  for (int f = 0; f < keyframe.size(); ++f) {
    Cells::Cell& cell = cells.at(keyframe.cameras[f], keyframe.pixels[f]);
    ++cell.corners;
    cell.camera = keyframe.cameras[f];
    cell.pixel += keyframe.pixels[f];
    cell.explained += is_explained(map, keyframe, f);
  }
  // What a turn took out of sight could not be found again.
  const auto left = [&](const Cells::Cell& cell) {
    if (number + 1 >= std::ssize(map.keyframes)) return false;
    const MapKeyFrame& next = map.keyframes[number + 1];
    const Eigen::Vector2d pixel = (cell.pixel / static_cast<float>(cell.corners)).cast<double>();
    return !stays_in_sight(rig, cell.camera, pixel,
                           next.rig_from_world.rotation * keyframe.rig_from_world.rotation.conjugate());
  };
  int judged = 0, unexplained = 0;
  for (const Cells::Cell& cell : cells.all()) {
    if (cell.corners < kCornersOfCell) continue;
    const bool is_unexplained = cell.explained < kExplained * cell.corners;
    if (is_unexplained && left(cell)) continue;
    ++judged;
    unexplained += is_unexplained;
  }
  if (judged < kCellsOfImage) return std::nullopt;
  return static_cast<double>(unexplained) / judged;
}

// Of a few key frames together; a stretch goes on where they overlap with it.
void MotionWatch::judge(const std::vector<Share>& shares, std::vector<OtherMotion>* seen) {
  if (shares.empty()) return;
  double mean = 0;
  for (const Share& share : shares) mean += share.part / static_cast<double>(shares.size());
  if (mean < kMuch) return;
  if (seen->empty() || seen->back().last < shares.front().frame) {
    seen->push_back({shares.front().frame, shares.back().frame, mean});
    return;
  }
  seen->back().last = shares.back().frame;
  seen->back().part = std::max(seen->back().part, mean);
}

void MotionWatch::add(int frame, double unexplained) {
  if (recent_.size() == kTogether) recent_.erase(recent_.begin());
  recent_.push_back({frame, unexplained});
  if (recent_.size() < kTogether) return;
  judge(recent_, &seen_);
  judged_ = true;
}

void MotionWatch::restart() {
  seen_ = seen();
  recent_.clear();
  judged_ = false;
}

bool MotionWatch::is_much() const {
  return !recent_.empty() && recent_.back().part > kMuch;
}

std::vector<OtherMotion> MotionWatch::seen() const {
  std::vector<OtherMotion> all = seen_;
  if (!judged_) judge(recent_, &all);
  return all;
}

}  // namespace raysfm
