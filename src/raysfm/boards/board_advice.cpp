#include "raysfm/boards/board_advice.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace raysfm {
namespace {

constexpr size_t kGoodViews = 10;

// What the kept images of one camera show.
struct Seen {
  ImageCells covered = {};
  size_t images = 0;
  int tilted = 0;      // images of a board that is turned away from the ray to its middle
  double largest = 0;  // board in an image, as a part of the image's smaller side
};

double tilt_deg(const Rigid3& cam_from_board) {
  const Eigen::Vector3d normal = cam_from_board.rotation * Eigen::Vector3d::UnitZ();
  const double cosine = std::abs(normal.dot(cam_from_board.translation.normalized()));
  return std::acos(std::min(1.0, cosine)) * 180 / std::numbers::pi;
}

Seen seen_by(const BoardProblem& problem, int c) {
  constexpr double kTilt = 15;  // degrees
  const Camera& camera = problem.rig.cameras[c];
  Seen seen;
  std::vector<Eigen::AlignedBox2d> boxes(problem.rig_from_board.size());
  for (const BoardObservation& o : problem.observations) {
    if (o.camera != c) continue;
    seen.covered[cell_of(camera, o.pixel)] = 1;
    boxes[o.view].extend(o.pixel);
  }
  for (size_t v = 0; v < boxes.size(); ++v) {
    if (boxes[v].isEmpty()) continue;
    ++seen.images;
    seen.tilted += tilt_deg(camera.rig_from_cam.inverse() * problem.rig_from_board[v]) > kTilt;
    seen.largest =
        std::max(seen.largest, boxes[v].sizes().maxCoeff() / std::min(camera.width, camera.height));
  }
  return seen;
}

std::string name_of_cell(int cell) {
  constexpr std::array kRows = {"upper", "upper", "", "lower", "lower"};
  constexpr std::array kColumns = {"left", "left", "", "right", "right"};
  const std::string row = kRows[cell / kCoverageCells], column = kColumns[cell % kCoverageCells];
  if (row.empty() && column.empty()) return "middle";
  if (row.empty()) return column + " side";
  return column.empty() ? row + " side" : row + " " + column;
}

// Parts of the image in which the camera sees something, but never the board.
std::string bare_parts(const Camera& camera, const Seen& seen, const ImageCells& lit) {
  std::vector<std::string> names;
  for (int cell = 0; cell < static_cast<int>(lit.size()); ++cell) {
    const Eigen::Vector2d middle((cell % kCoverageCells + 0.5) * camera.width / kCoverageCells - 0.5,
                                 (cell / kCoverageCells + 0.5) * camera.height / kCoverageCells - 0.5);
    Ray ray;
    if (seen.covered[cell] || !lit[cell] || !camera.ray(middle, &ray)) continue;
    const std::string name = name_of_cell(cell);
    if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

void advise(const BoardCalibration& calibration, int c, const ImageCells& lit,
            std::vector<std::string>* advice) {
  constexpr double kPoor = 0.01, kLargeError = 1.0, kSmallBoard = 0.3;
  const Camera& camera = calibration.problem.rig.cameras[c];
  const Seen seen = seen_by(calibration.problem, c);
  const auto say = [&](const std::string& text) { advice->push_back(camera.name + ": " + text); };
  if (seen.images < kGoodViews) {
    say(fmt::format("only {} different views of the board; film {} and more", seen.images, kGoodViews));
  }
  const std::string bare = bare_parts(camera, seen, lit);
  if (!bare.empty()) say("no corner of the board in a part of the image: " + bare + "; hold the board there");
  if (4 * seen.tilted < static_cast<int>(seen.images)) {
    say(fmt::format("{} of {} views show the board tilted; tilt it by 20 degrees and more, to all sides",
                    seen.tilted, seen.images));
  }
  if (seen.largest < kSmallBoard) {
    say(fmt::format("the board is never larger than {:.0f} % of the image; come closer", 100 * seen.largest));
  }
  const double sigma = calibration.sigmas.focal[c];
  if (sigma > kPoor) {
    say(fmt::format(
        "the focal length is told within {:.1f} % only; show the board tilted, near and to all sides",
        100 * sigma));
  }
  const double rms = calibration.camera_rms_px[c], alone = calibration.alone_rms_px[c];
  if (alone > kLargeError) {
    say(fmt::format("corners are {:.2g} px off; keep the board flat and still, or try another --model",
                    alone));
  }
  if (rms > 1.5 * alone + 0.05) {
    say(fmt::format(
        "corners are {:.2g} px off in the rig, {:.2g} px alone; the cameras are not in step, or moved "
        "against each other",
        rms, alone));
  }
}

}  // namespace

int cell_of(const Camera& camera, const Eigen::Vector2d& pixel) {
  const auto part = [](double at, int size) {
    return std::clamp(static_cast<int>((at + 0.5) / size * kCoverageCells), 0, kCoverageCells - 1);
  };
  return part(pixel.y(), camera.height) * kCoverageCells + part(pixel.x(), camera.width);
}

std::vector<std::string> board_advice(const BoardCalibration& calibration, std::span<const ImageCells> lit) {
  std::vector<std::string> advice;
  for (int c = 0; c < static_cast<int>(calibration.problem.rig.cameras.size()); ++c) {
    advise(calibration, c, lit[c], &advice);
  }
  return advice;
}

}  // namespace raysfm
