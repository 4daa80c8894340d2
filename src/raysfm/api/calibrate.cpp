#include "raysfm/api/calibrate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "raysfm/boards/view_choice.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/camera/model_starts.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/features/sharpness.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/matching/board_corners.h"

namespace raysfm {
namespace {

constexpr int kMostLooks = 150;  // of a long video
constexpr int kWhile = 8;        // frames, of a video that does not say how many it has
constexpr int kMostViews = 80;
constexpr double kAlike = 0.01;  // mean distance of corners, of the image's larger side
constexpr int kMinSide = 3, kMaxSide = 64;

Result<Board> board_of(const CalibrateSettings& settings) {
  Board board;
  const std::string& text = settings.board;
  const char* end = text.data() + text.size();
  const auto [cross, no_columns] = std::from_chars(text.data(), end, board.columns);
  bool good = no_columns == std::errc() && cross != end && *cross == 'x';
  if (good) {
    const auto [rest, no_rows] = std::from_chars(cross + 1, end, board.rows);
    good = no_rows == std::errc() && rest == end;
  }
  const auto possible = [](int side) { return side >= kMinSide && side <= kMaxSide; };
  if (!good || !possible(board.columns) || !possible(board.rows)) {
    return bad_input(
        fmt::format("--board = '{}': allowed: inner corners along both sides, {} to {}, as in 9x6", text,
                    kMinSide, kMaxSide));
  }
  if (!(settings.square >= 0) || !std::isfinite(settings.square)) {
    return bad_input(fmt::format("--square = {}: must be above 0, in metres", settings.square));
  }
  board.square = settings.square > 0 ? settings.square : 1;
  return board;
}

Result<void> check_model(const std::string& model) {
  if (model == "auto" || !model_starts(model, 1, Eigen::Vector2d::Zero()).empty()) return {};
  return bad_input(fmt::format("--model = '{}': allowed: auto, {}", model, kModelsWithStart));
}

// Reads the streams, and finds the board in the sharpest frames.
class BoardReader {
 public:
  BoardReader(const Board& board, const std::vector<std::unique_ptr<FrameSource>>& streams,
              const CalibrateCallbacks& callbacks)
      : board_(board), streams_(streams), callbacks_(callbacks), lit_(streams.size()) {
    int count = streams[0]->frame_count();
    for (const auto& stream : streams) {
      stream->allow_any_size();
      if (stream->frame_count() >= 0) count = std::min(count, stream->frame_count());
    }
    total_ = count;
    while_ = count < 0 ? kWhile : 1 + (count - 1) / kMostLooks;
  }

  Result<void> run() {
    FrameSetReader reader(streams_);
    for (int frame = 0;; ++frame) {
      if (callbacks_.stopped()) return no_reconstruction("interrupted");
      Result<std::vector<InputFrame>> set = reader.next();
      if (!set) return set.error();
      if (set->empty()) break;
      if (auto r = check_sizes(*set); !r) return r;
      consider(*std::move(set));
      if ((frame + 1) % while_ != 0) continue;
      if (auto r = look(); !r) return r;
      if (callbacks_.progress) callbacks_.progress(frame + 1, total_);
    }
    if (auto r = look(); !r) return r;
    if (const std::string note = reader.note(); !note.empty()) notes_.push_back(note);
    return {};
  }

  std::vector<BoardView>& views() { return views_; }
  const std::vector<ImageCells>& lit() const { return lit_; }
  const std::vector<std::string>& notes() const { return notes_; }
  const std::vector<std::string>& unseen() const { return unseen_; }
  const std::vector<GrayImage>& samples() const { return samples_; }
  int images() const { return images_; }

 private:
  Result<void> check_sizes(const std::vector<InputFrame>& set) const {
    for (size_t s = 0; s < set.size(); ++s) {
      const FrameSource& stream = *streams_[s];
      const GrayImage& image = set[s].gray;
      if (!set[s].defect.empty()) continue;
      if (image.width() == stream.width() && image.height() == stream.height()) continue;
      return bad_input(fmt::format("{}: the image is {}x{}; allowed: the size of the first, {}x{}",
                                   set[s].name, image.width(), image.height(), stream.width(),
                                   stream.height()));
    }
    return {};
  }

  // Keeps the sharper of this set and the one before: an image without contrast is the least sharp.
  void consider(std::vector<InputFrame> set) {
    double width = 0;
    if (while_ > 1) {
      for (const InputFrame& frame : set) {
        const float edge = frame.defect.empty() ? edge_width(frame.gray.view()) : 0;
        width = std::max(width, edge > 0 ? double(edge) : 1e9);
      }
    }
    if (!best_.empty() && !(width < best_width_)) return;
    best_ = std::move(set);
    best_width_ = width;
  }

  Result<void> look() {
    BoardView view;
    for (int s = 0; s < static_cast<int>(best_.size()); ++s) {
      const InputFrame& frame = best_[s];
      if (!frame.defect.empty()) continue;
      ++images_;
      note_light(frame.gray, &lit_[s]);
      auto corners = find_board_corners(frame.gray.view(), board_.columns, board_.rows);
      if (!corners) return corners.error();
      if (corners->empty()) {
        unseen_.push_back(frame.name);
        if (samples_.size() < kSamples) samples_.push_back(std::move(best_[s].gray));
        continue;
      }
      view.push_back({s, frame.name, *std::move(corners)});
    }
    if (!view.empty()) views_.push_back(std::move(view));
    best_.clear();
    return {};
  }

  static void note_light(const GrayImage& image, ImageCells* lit) {
    constexpr int kStep = 4, kDark = 20;  // pixels, grey levels
    std::array<int64_t, std::tuple_size_v<ImageCells>> sum = {}, count = {};
    for (int y = 0; y < image.height(); y += kStep) {
      for (int x = 0; x < image.width(); x += kStep) {
        const int cell =
            kCoverageCells * (y * kCoverageCells / image.height()) + x * kCoverageCells / image.width();
        sum[cell] += image.row(y)[x];
        ++count[cell];
      }
    }
    for (size_t cell = 0; cell < sum.size(); ++cell) (*lit)[cell] |= sum[cell] > kDark * count[cell];
  }

  static constexpr size_t kSamples = 8;
  const Board& board_;
  const std::vector<std::unique_ptr<FrameSource>>& streams_;
  const CalibrateCallbacks& callbacks_;
  int total_ = -1, while_ = 1, images_ = 0;
  std::vector<InputFrame> best_;  // of this while
  double best_width_ = 0;
  std::vector<BoardView> views_;
  std::vector<ImageCells> lit_;
  std::vector<std::string> notes_, unseen_;
  std::vector<GrayImage> samples_;  // images without the board
};

// What board the images may show that is not the one told.
Error no_board(const BoardReader& reader, const CalibrateSettings& settings) {
  std::vector<std::array<int, 2>> sizes;
  for (const GrayImage& image : reader.samples()) {
    const auto size = guess_board_size(image.view());
    if (size && (*size)[0] > 0) sizes.push_back(*size);
  }
  std::string hint;
  std::ptrdiff_t most = 1;
  for (const auto& size : sizes) {
    const auto count = std::ranges::count(sizes, size);
    if (count <= most) continue;
    most = count;
    hint = fmt::format("; one of {}x{} seems to be there", size[0], size[1]);
  }
  return bad_input(fmt::format(
      "{}: no board of {} inner corners in any of {} images; allowed: --board COLUMNSxROWS, the inner "
      "corners along its sides, and images that show all of it{}",
      fmt::join(settings.inputs, ", "), settings.board, reader.images(), hint));
}

std::vector<Camera> bare_cameras(const std::vector<std::unique_ptr<FrameSource>>& streams) {
  std::vector<Camera> cameras;
  for (size_t s = 0; s < streams.size(); ++s) {
    Camera& camera = cameras.emplace_back();
    camera.name = streams.size() == 1 ? "camera" : fmt::format("cam{}", s);
    camera.stream = static_cast<int>(s);
    camera.width = streams[s]->width();
    camera.height = streams[s]->height();
  }
  return cameras;
}

// Those that differ, as many as are of use.
Result<std::vector<BoardView>> chosen_views(const std::vector<BoardView>& views,
                                            const std::vector<Camera>& cameras) {
  int side = 0;
  for (const Camera& camera : cameras) side = std::max({side, camera.width, camera.height});
  const std::vector<int> chosen = differing_views(views, kAlike * side, kMostViews);
  if (static_cast<int>(chosen.size()) < 3) {
    return bad_input(fmt::format(
        "views: {} images show the board, {} of them from a place of its own; allowed: at least 3 that "
        "differ, better 15, the board tilted to different sides",
        views.size(), chosen.size()));
  }
  std::vector<BoardView> kept;
  for (const int v : chosen) kept.push_back(views[v]);
  return kept;
}

std::string number_comment(std::string_view camera, std::string_view name, double sigma) {
  if (!std::isfinite(sigma)) return fmt::format("# {} {}: not told by these views\n", camera, name);
  return fmt::format("# {} {}: standard deviation {:.3g}\n", camera, name, sigma);
}

}  // namespace

std::vector<SettingField> setting_fields(CalibrateSettings& s) {
  return {
      {"board", "inner corners of the chessboard, COLUMNSxROWS", &s.board, {}},
      {"square", "side of a square, metres; 0: not told, places in the rig are in squares", &s.square, {}},
      {"model", "camera model, of those of camera files; auto: radtan or kannala-brandt", &s.model, {}},
      {"fps", "frames per second of inputs without timestamps", &s.fps, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
  };
}

Result<CalibrateResult> calibrate(const CalibrateSettings& settings, const CalibrateCallbacks& callbacks) {
  const Result<Board> board = board_of(settings);
  if (!board) return board.error();
  if (auto r = check_model(settings.model); !r) return r.error();
  if (auto r = check_threads(settings.threads); !r) return r.error();
  Result<Input> input = open_input(
      settings.inputs, {.fps = settings.fps, .ignore_calibration = true, .threads = settings.threads});
  if (!input) return input.error();
  if (callbacks.ready) {
    if (auto r = callbacks.ready(); !r) return r.error();
  }
  BoardReader reader(*board, input->streams, callbacks);
  if (auto r = reader.run(); !r) return r.error();
  if (reader.views().empty()) return no_board(reader, settings);
  const std::vector<Camera> cameras = bare_cameras(input->streams);
  Result<std::vector<BoardView>> views = chosen_views(reader.views(), cameras);
  if (!views) return views.error();
  CalibrateResult result;
  result.images = reader.images();
  result.found = reader.images() - static_cast<int>(reader.unseen().size());
  result.views = static_cast<int>(views->size());
  result.notes = reader.notes();
  Result<BoardCalibration> calibration = calibrate_boards(*board, cameras, settings.model, *std::move(views));
  if (!calibration) return calibration.error();
  result.calibration = *std::move(calibration);
  result.advice = board_advice(result.calibration, reader.lit());
  return result;
}

std::string calibrated_camera_text(const CalibrateResult& result, const CalibrateSettings& settings) {
  const BoardCalibration& calibration = result.calibration;
  std::string text = fmt::format("# From {} views of a board of {} inner corners, rms {:.3g} px.\n",
                                 result.views, settings.board, calibration.rms_px);
  const Rig& rig = calibration.problem.rig;
  if (rig.cameras.size() > 1) {
    text += settings.square > 0 ? "# Places are in metres.\n" : "# Places are in squares of the board.\n";
  }
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    const auto parameters = camera_parameters(rig.cameras[c].model);
    for (size_t i = 0; i < parameters.size(); ++i) {
      if (calibration.problem.scales[c][i] == 0) continue;
      text += number_comment(rig.cameras[c].name, parameters[i].first, calibration.sigmas.numbers[c][i]);
    }
    if (c == 0) continue;
    const auto& sigma = calibration.sigmas.pose[c];
    text += number_comment(rig.cameras[c].name, "place", sigma.head<3>().norm());
    text += number_comment(rig.cameras[c].name, "rotation, radians", sigma.tail<3>().norm());
  }
  return text + format_camera_file(rig);
}

}  // namespace raysfm
