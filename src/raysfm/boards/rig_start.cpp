#include "raysfm/boards/rig_start.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace raysfm {
namespace {

constexpr double kAgreeing = 0.06;  // radians, and the same part of the distance from the board

// By how many quarters a board may be turned without a difference that a camera sees.
std::vector<int> possible_turns(const Board& board) {
  if (board.columns == board.rows) return {0, 1, 2, 3};
  if ((board.columns + board.rows) % 2 == 0) return {0, 2};
  return {0};
}

Rigid3 turned_from_board(int quarters) {
  return {exp_so3({0, 0, 0.5 * std::numbers::pi * quarters}), Eigen::Vector3d::Zero()};
}

// The corners in the order in which the board has them that is turned by so many quarters.
std::vector<Eigen::Vector2d> turned(const Board& board, const std::vector<Eigen::Vector2d>& pixels,
                                    int quarters) {
  if (quarters == 0) return pixels;
  if (quarters == 2) return {pixels.rbegin(), pixels.rend()};
  std::vector<Eigen::Vector2d> result(pixels.size());
  const int n = board.columns;  // as many as rows
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const int from = quarters == 1 ? column * n + (n - 1 - row) : (n - 1 - column) * n + row;
      result[from] = pixels[row * n + column];
    }
  }
  return result;
}

bool agree(const Rigid3& a, const Rigid3& b, double distance) {
  return a.rotation.angularDistance(b.rotation) < kAgreeing &&
         (a.translation - b.translation).norm() < kAgreeing * distance;
}

class RigStart {
 public:
  RigStart(std::span<const BoardProblem> alone, std::vector<BoardView>* views)
      : alone_(alone),
        views_(*views),
        turns_(possible_turns(alone[0].board)),
        placed_(alone.size(), 0),
        seen_(alone.size(), std::vector<uint8_t>(views->size(), 0)) {
    for (size_t c = 0; c < alone.size(); ++c) {
      for (const BoardObservation& o : alone[c].observations) seen_[c][o.view] = 1;
    }
    problem_.board = alone[0].board;
    problem_.rig_from_board.assign(views->size(), Rigid3{});
    view_placed_.assign(views->size(), 0);
    for (const BoardProblem& one : alone) {
      problem_.rig.cameras.push_back(one.rig.cameras[0]);
      problem_.scales.push_back(one.scales[0]);
    }
  }

  Result<BoardProblem> run() {
    place(0, Rigid3{});
    for (size_t count = 1; count < alone_.size(); ++count) {
      const int camera = next_camera();
      const std::optional<Rigid3> pose = camera < 0 ? std::nullopt : most_agreed(camera);
      if (!pose) {
        const auto missing = std::ranges::find(placed_, 0) - placed_.begin();
        return bad_input(fmt::format(
            "{}: never sees the board together with another camera; allowed: inputs of one rig, with "
            "the board in front of two cameras at the same instants",
            alone_[missing].rig.cameras[0].name));
      }
      place(camera, *pose);
    }
    return problem_;
  }

 private:
  // The one that shares most views with those placed; -1: none shares any.
  int next_camera() const {
    int best = -1;
    std::ptrdiff_t most = 0;
    for (size_t c = 0; c < alone_.size(); ++c) {
      std::ptrdiff_t shared = 0;
      for (size_t v = 0; v < views_.size(); ++v) shared += !placed_[c] && seen_[c][v] && view_placed_[v];
      if (shared > most) best = static_cast<int>(c), most = shared;
    }
    return best;
  }

  // rig_from_cam by one view, with the board turned.
  Rigid3 by_view(int camera, size_t view, int quarters) const {
    const Rigid3 cam_from_turned =
        alone_[camera].rig_from_board[view] * turned_from_board(quarters).inverse();
    return problem_.rig_from_board[view] * cam_from_turned.inverse();
  }
  double distance(int camera, size_t view) const {
    return alone_[camera].rig_from_board[view].translation.norm();
  }

  // The pose by one view with which most other views agree.
  std::optional<Rigid3> most_agreed(int camera) const {
    std::optional<Rigid3> best;
    int most = 0;
    for (size_t v = 0; v < views_.size(); ++v) {
      if (!seen_[camera][v] || !view_placed_[v]) continue;
      for (const int quarters : turns_) {
        const Rigid3 pose = by_view(camera, v, quarters);
        int count = 0;
        for (size_t u = 0; u < views_.size(); ++u) {
          count += seen_[camera][u] && view_placed_[u] && std::ranges::any_of(turns_, [&](int q) {
                     return agree(pose, by_view(camera, u, q), distance(camera, u));
                   });
        }
        if (count > most) best = pose, most = count;
      }
    }
    return best;
  }

  void place(int camera, const Rigid3& rig_from_cam) {
    placed_[camera] = 1;
    problem_.rig.cameras[camera].rig_from_cam = rig_from_cam;
    for (size_t v = 0; v < views_.size(); ++v) {
      if (!seen_[camera][v]) continue;
      if (!view_placed_[v]) {
        problem_.rig_from_board[v] = rig_from_cam * alone_[camera].rig_from_board[v];
        view_placed_[v] = 1;
        continue;
      }
      for (const int quarters : turns_) {
        if (!agree(rig_from_cam, by_view(camera, v, quarters), distance(camera, v))) continue;
        for (BoardImage& image : views_[v]) {
          if (image.camera == camera) image.pixels = turned(problem_.board, image.pixels, quarters);
        }
        break;
      }
    }
  }

  const std::span<const BoardProblem> alone_;
  std::vector<BoardView>& views_;
  const std::vector<int> turns_;
  std::vector<uint8_t> placed_, view_placed_;
  std::vector<std::vector<uint8_t>> seen_;  // by camera and view
  BoardProblem problem_;
};

}  // namespace

Result<BoardProblem> start_rig(std::span<const BoardProblem> alone, std::vector<BoardView>* views) {
  return RigStart(alone, views).run();
}

}  // namespace raysfm
