// Lenses from the corners of boards. First tables 1 and 2 of IFBA01: images of two orthogonal checkerboards
// by one lens and by a zooming one, rendered, the corners found by OpenCV; nothing is known of the boards.
// Then real boards, one plane each, whose corners are known, beside OpenCV's calibration of the same corners.
//
//   lens_boards_benchmark [SEEDS]           prints the tables; 20 seeds unless told
//   lens_boards_benchmark --corners FOLDER  writes the corners of the real boards as files that solve reads
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/core/timer.h"
#include "raysfm/synth/motion.h"
#include "raysfm/synth/renderer.h"
#include "raysfm/synth/zoom.h"
#include "raysfm/uncalibrated/known_structure.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 1024, kHeight = 768;
constexpr double kMaxError = 0.5;  // pixels, as --max-error; ten times the error of a corner
constexpr double kDegree = std::numbers::pi / 180;

// What a rendered set of images is made of.
struct Shot {
  std::vector<Lens> lenses;
  std::vector<Rigid3> cam_from_world;
  PointTracks tracks;     // of the corners found
  double corner_rms = 0;  // pixels, of the corners found about where they are
};

cv::Mat render(synth::Renderer& renderer, const Rigid3& world_from_cam, int number) {
  const Image<uint8_t> bgr = renderer.render([&](double) { return world_from_cam; }, 0, number);
  cv::Mat gray(kHeight, kWidth, CV_8UC1);
  for (int y = 0; y < kHeight; ++y) {
    const cv::Mat row(1, kWidth, CV_8UC3, const_cast<uint8_t*>(bgr.row(y)));
    cv::Mat target = gray.row(y);
    cv::cvtColor(row, target, cv::COLOR_BGR2GRAY);
  }
  return gray;
}

Camera camera_of(const Lens& lens) {
  Camera camera;
  camera.name = "board";
  camera.model = Pinhole{lens.fx, lens.fy, lens.cx, lens.cy};
  camera.width = kWidth;
  camera.height = kHeight;
  return camera;
}

// A camera in front of the edge between the boards, so far away that they fill the image whatever the lens.
Rigid3 place(const Lens& lens, Rng& rng) {
  // Between the floor of the room and its ceiling.
  const double azimuth = rng.uniform(-22, 22) * kDegree, height = rng.uniform(-4, 20) * kDegree;
  const double distance = rng.uniform(1.9, 2.3) * lens.fx / 750;
  const Eigen::Vector3d position =
      distance * Eigen::Vector3d(std::sin(azimuth) * std::cos(height), -std::sin(height),
                                 -std::cos(azimuth) * std::cos(height));
  const Eigen::Vector3d target(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), 0);
  const Eigen::Vector3d z = (target - position).normalized(),
                        x = Eigen::Vector3d::UnitY().cross(z).normalized();
  Eigen::Matrix3d world_from_cam;
  world_from_cam << x, z.cross(x), z;
  const Eigen::Quaterniond roll = exp_so3({0, 0, rng.uniform(-30, 30) * kDegree});
  return {(Eigen::Quaterniond(world_from_cam) * roll).normalized(), position};
}

// Half the side of the window in which a corner is looked for: less than half a square, however it is seen.
int window_of(const std::vector<cv::Point2f>& corners, size_t i) {
  double nearest = 1e9;
  for (size_t k = 0; k < corners.size(); ++k) {
    if (k != i) nearest = std::min<double>(nearest, cv::norm(corners[k] - corners[i]));
  }
  return std::clamp(static_cast<int>(0.35 * nearest), 2, 7);
}

// Looks for the corners from a pixel beside where they are; which corner is which is known.
void find_corners(const cv::Mat& image, const Camera& camera, const Rigid3& cam_from_world,
                  const std::vector<Eigen::Vector3d>& landmarks, int number, Rng& rng, Shot* shot) {
  std::vector<cv::Point2f> corners;
  std::vector<int> points;
  for (size_t i = 0; i < landmarks.size(); ++i) {
    Eigen::Vector2d pixel;
    if (!camera.project(cam_from_world * landmarks[i], &pixel)) continue;
    if (pixel.x() < 10 || pixel.y() < 10 || pixel.x() > kWidth - 11 || pixel.y() > kHeight - 11) continue;
    corners.emplace_back(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()));
    points.push_back(static_cast<int>(i));
  }
  for (size_t i = 0; i < corners.size(); ++i) {
    const int window = window_of(corners, i);
    const Eigen::Vector2d truth(corners[i].x, corners[i].y);
    std::vector<cv::Point2f> one = {corners[i] + cv::Point2f(static_cast<float>(rng.uniform(-1, 1)),
                                                             static_cast<float>(rng.uniform(-1, 1)))};
    cv::cornerSubPix(image, one, {window, window}, {-1, -1},
                     cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4));
    const Eigen::Vector2d pixel(one[0].x, one[0].y);
    shot->corner_rms += (pixel - truth).squaredNorm();
    shot->tracks.add(number, points[i], pixel);
  }
}

struct View {
  Lens lens;
  Rigid3 world_from_cam;
};

Shot shoot(const synth::World& world, const std::vector<View>& views, uint64_t seed, ThreadPool& pool) {
  Rng rng(seed, 2);
  Shot shot;
  shot.tracks.image_count = static_cast<int>(views.size());
  shot.tracks.point_count = static_cast<int>(world.landmarks.size());
  shot.tracks.image_size = {kWidth, kHeight};
  synth::Renderer renderer(world, camera_of(views[0].lens), {.samples = 9, .noise = 1, .seed = seed}, pool);
  for (int j = 0; j < shot.tracks.image_count; ++j) {
    const Camera camera = camera_of(views[j].lens);
    const Rigid3& world_from_cam = views[j].world_from_cam;
    renderer.change_lens(camera);
    find_corners(render(renderer, world_from_cam, j), camera, world_from_cam.inverse(), world.landmarks, j,
                 rng, &shot);
    shot.lenses.push_back(views[j].lens);
    shot.cam_from_world.push_back(world_from_cam.inverse());
  }
  shot.corner_rms = std::sqrt(shot.corner_rms / shot.tracks.size());
  return shot;
}

// Places at random, focal lengths as given, principal points about the centre.
std::vector<View> views_at_random(const std::vector<double>& focal, double centre_spread, uint64_t seed) {
  Rng rng(seed, 1);
  std::vector<View> views;
  for (const double f : focal) {
    const Lens lens{f, f, 0.5 * (kWidth - 1) + centre_spread * rng.normal(),
                    0.5 * (kHeight - 1) + centre_spread * rng.normal(), 0};
    views.push_back({lens, place(lens, rng)});
  }
  return views;
}

// As scripts/recipes/board-fixed.yaml and board-zoom.yaml: round the boards, the zoom going away from them.
std::vector<View> views_of_recipe(const synth::World& world, int count, double zoom, uint64_t seed) {
  constexpr double kDuration = 6;
  const auto motion =
      synth::make_motion(world.stage, world.habit, {zoom == 1 ? "orbit" : "dolly", kDuration, 1, seed, zoom});
  std::vector<View> views;
  for (int j = 0; j < count; ++j) {
    const double part = double(j) / (count - 1), f = 750 * synth::zoom_factor(zoom, part);
    views.push_back({{f, f, 0.5 * (kWidth - 1), 0.5 * (kHeight - 1), 0}, (*motion)(kDuration * part)});
  }
  return views;
}

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

double largest(const std::vector<double>& values) {
  return values.empty() ? NAN : *std::max_element(values.begin(), values.end());
}

// Errors of one way of solving, of every image of every seed.
struct Errors {
  std::vector<double> focal_percent, centre_px, rms_px, iterations,
      ms;  // ms: of the start and the adjustment
  int failures = 0, wrong_lens = 0;

  void add(const std::vector<Lens>& found, const std::vector<Lens>& truth) {
    for (size_t j = 0; j < truth.size(); ++j) {
      focal_percent.push_back(100 * std::abs(found[j].fx / truth[j].fx - 1));
      centre_px.push_back(std::hypot(found[j].cx - truth[j].cx, found[j].cy - truth[j].cy));
    }
  }
  void print(const std::string& name) const {
    std::printf("| %s | %.2f %% | %.2f %% | %.1f px | %.1f px |", name.c_str(), median(focal_percent),
                largest(focal_percent), median(centre_px), largest(centre_px));
    if (rms_px.empty()) std::printf(" |");
    if (!rms_px.empty()) std::printf(" %.3f px |", median(rms_px));
    std::printf(" %d | %d |", failures, wrong_lens);
    if (iterations.empty()) std::printf(" | |\n");
    if (!iterations.empty()) std::printf(" %.0f | %.2f |\n", median(iterations), median(ms));
  }
};

constexpr std::pair<const char*, LensMethod> kMethods[] = {{"intrinsics-free", LensMethod::kIntrinsicsFree},
                                                           {"standard", LensMethod::kStandard},
                                                           {"polished", LensMethod::kPolished}};

void solve_shot(const Shot& shot, bool zooming, std::map<std::string, Errors>* errors) {
  SolveOptions options;
  options.lens = zooming ? LensChange::kZoom : LensChange::kFixed;
  options.max_error_px = kMaxError;
  const auto linear = linear_start(shot.tracks, options, !zooming);
  if (linear) {
    (*errors)["linear"].add(linear->lenses, shot.lenses);
  } else {
    ++(*errors)["linear"].failures;
  }
  const auto take = [&](const std::string& name) {
    Errors& e = (*errors)[name];
    const Clock::time_point begin = Clock::now();
    const auto found = reconstruct(shot.tracks, options);
    e.ms.push_back(milliseconds_since(begin));
    if (!found || std::count(found->image_posed.begin(), found->image_posed.end(), 0) > 0) {
      ++e.failures;
      return;
    }
    e.add(found->scene.lenses, shot.lenses);
    e.rms_px.push_back(found->rms_px);
    e.iterations.push_back(found->adjustment.lm.iterations);
    e.wrong_lens += found->zooming != zooming;
  };
  for (const auto& [name, method] : kMethods) {
    options.method = method;
    take(name);
  }
  options.lens = LensChange::kAuto;
  take("polished, `--lens auto`");
}

void print_focal_lengths(const Shot& shot, bool zooming) {
  std::printf("\nSeed 0, focal lengths by image:\n\n| |");
  for (size_t j = 0; j < shot.lenses.size(); ++j) std::printf(" f%zu |", j + 1);
  std::printf("\n|---|");
  for (size_t j = 0; j < shot.lenses.size(); ++j) std::printf("---|");
  std::printf("\n| truth |");
  for (const Lens& lens : shot.lenses) std::printf(" %.1f |", lens.fx);
  for (const auto& [name, method] : kMethods) {
    const auto found = reconstruct(shot.tracks, {.lens = zooming ? LensChange::kZoom : LensChange::kFixed,
                                                 .method = method,
                                                 .max_error_px = kMaxError});
    if (!found) continue;
    std::printf("\n| %s |", name);
    for (const Lens& lens : found->scene.lenses) std::printf(" %.1f |", lens.fx);
  }
  std::printf("\n\n");
}

template <typename MakeViews>
void rendered_table(const char* title, bool zooming, int seeds, const synth::World& world, ThreadPool& pool,
                    MakeViews make_views) {
  std::map<std::string, Errors> errors;
  std::vector<double> corner_rms;
  Shot first;
  for (int seed = 0; seed < seeds; ++seed) {
    const auto number = static_cast<uint64_t>(seed);
    const Shot shot = shoot(world, make_views(number), number, pool);
    corner_rms.push_back(shot.corner_rms);
    solve_shot(shot, zooming, &errors);
    if (seed == 0) first = shot;
  }
  std::printf("%s: %zu images, %d seeds, corners found within %.3f px (root mean square)\n\n", title,
              first.lenses.size(), seeds, median(corner_rms));
  std::printf(
      "| | focal length, median | largest | principal point, median | largest | rms | failures | lens "
      "mistaken | iterations | ms |\n|---|---|---|---|---|---|---|---|---|---|\n");
  for (const char* name : {"linear", "intrinsics-free", "standard", "polished", "polished, `--lens auto`"}) {
    errors[name].print(name);
  }
  print_focal_lengths(first, zooming);
  std::fflush(stdout);
}

// Real boards of 9 x 6 corners.
struct Board {
  PointTracks tracks;
  std::vector<std::string> names;
  std::vector<Eigen::Vector3d> corners;  // of the board, in squares
};

Board real_board(const std::string& prefix) {
  Board board;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(testing_support::shared_data("boards/pinhole-stereo"))) {
    if (entry.path().filename().string().starts_with(prefix)) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  for (int i = 0; i < 54; ++i) board.corners.emplace_back(i % 9, i / 9, 0);
  for (const fs::path& file : files) {
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    std::vector<cv::Point2f> corners;
    if (!cv::findChessboardCorners(image, {9, 6}, corners)) continue;
    cv::cornerSubPix(image, corners, {5, 5}, {-1, -1},
                     cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4));
    for (int i = 0; i < 54; ++i) {
      board.tracks.add(static_cast<int>(board.names.size()), i, {corners[i].x, corners[i].y});
    }
    board.names.push_back(file.stem().string());
    board.tracks.image_size = {image.cols, image.rows};
  }
  board.tracks.image_count = static_cast<int>(board.names.size());
  board.tracks.point_count = 54;
  return board;
}

// OpenCV's calibration of the same corners: square pixels, the numbers of distortion that solve has.
Lens opencv_lens(const Board& board, double* k1, double* k2, double* rms) {
  std::vector<std::vector<cv::Point3f>> points(board.tracks.image_count);
  std::vector<std::vector<cv::Point2f>> corners(board.tracks.image_count);
  for (int k = 0; k < board.tracks.size(); ++k) {
    const Eigen::Vector3f x = board.corners[board.tracks.point[k]].cast<float>();
    points[board.tracks.image[k]].emplace_back(x.x(), x.y(), x.z());
    corners[board.tracks.image[k]].emplace_back(static_cast<float>(board.tracks.pixel[k].x()),
                                                static_cast<float>(board.tracks.pixel[k].y()));
  }
  cv::Mat k = cv::Mat::eye(3, 3, CV_64F), d, r, t;
  *rms = cv::calibrateCamera(
      points, corners,
      {static_cast<int>(board.tracks.image_size.x()), static_cast<int>(board.tracks.image_size.y())}, k, d, r,
      t, cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K3);
  *k1 = d.at<double>(0);
  *k2 = d.at<double>(1);
  return {k.at<double>(0, 0), k.at<double>(1, 1), k.at<double>(0, 2), k.at<double>(1, 2), 0};
}

void print_lens(const char* name, const Lens& lens, double k1, double k2, double rms) {
  std::printf("| %s | %.2f | %.2f, %.2f | %.4f | %.4f | %.4f px |\n", name, lens.fx, lens.cx, lens.cy, k1, k2,
              rms);
}

void real_tables() {
  for (const std::string prefix : {"left", "right"}) {
    const Board board = real_board(prefix);
    double k1 = 0, k2 = 0, rms = 0;
    std::printf("boards/pinhole-stereo, %s: %d images\n\n", prefix.c_str(), board.tracks.image_count);
    std::printf("| | f | c | k1 | k2 | rms |\n|---|---|---|---|---|---|\n");
    const Lens opencv = opencv_lens(board, &k1, &k2, &rms);
    print_lens("OpenCV", opencv, k1, k2, rms);
    const auto known = reconstruct_known(board.tracks, board.corners, {});
    if (known) {
      print_lens("known structure", known->scene.lenses[0], known->radial.k1, known->radial.k2,
                 known->rms_px);
      std::printf("\nfocal length %+.3f %% from OpenCV's, sigma %.2f px; lens %s: %s\n",
                  100 * (known->scene.lenses[0].fx / opencv.fx - 1), known->lens_sigma[0][0],
                  known->zooming ? "zooming" : "fixed", known->lens_evidence.c_str());
    } else {
      std::printf("\nknown structure: %s\n", known.error().message.c_str());
    }
    const auto unknown = reconstruct(board.tracks, {});
    std::printf("nothing known: %s\n\n",
                unknown ? ("a reconstruction, degenerate: " + unknown->degenerate).c_str()
                        : unknown.error().message.c_str());
  }
}

int write_corners(const fs::path& folder) {
  fs::create_directories(folder);
  for (const std::string prefix : {"left", "right"}) {
    const Board board = real_board(prefix);
    std::ofstream file(folder / (prefix + ".csv"));
    file << "image,point,u,v\n";
    for (int k = 0; k < board.tracks.size(); ++k) {
      file << board.names[board.tracks.image[k]] << ',' << board.tracks.point[k] << ','
           << board.tracks.pixel[k].x() << ',' << board.tracks.pixel[k].y() << '\n';
    }
    std::ofstream structure(folder / "board.csv");
    structure << "point,x,y,z\n";
    for (int i = 0; i < 54; ++i) {
      structure << i << ',' << board.corners[i].x() << ',' << board.corners[i].y() << ",0\n";
    }
    if (!file || !structure) return 1;
  }
  std::printf("left.csv, right.csv and board.csv are in %s\n", folder.c_str());
  return 0;
}

void tables(int seeds) {
  ThreadPool pool(1);
  const Result<synth::World> world = synth::make_world("board", {}, pool);
  rendered_table("Table 1, one lens", false, seeds, *world, pool, [](uint64_t seed) {
    return views_at_random({757.5, 757.5, 757.5}, 0, seed);
  });
  rendered_table("Table 2, a zooming lens", true, seeds, *world, pool, [](uint64_t seed) {
    return views_at_random({751.9, 754.1, 757.2, 765.5, 1161.7, 1992.5, 1943.6}, 10, seed);
  });
  rendered_table("Recipe board-fixed", false, seeds, *world, pool,
                 [&](uint64_t seed) { return views_of_recipe(*world, 3, 1, seed); });
  rendered_table("Recipe board-zoom", true, seeds, *world, pool,
                 [&](uint64_t seed) { return views_of_recipe(*world, 7, 2.6666666667, seed); });
  if (fs::exists(testing_support::shared_data("boards/pinhole-stereo"))) real_tables();
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "--corners") return raysfm::write_corners(argv[2]);
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 20;
  if (argc > 2 || seeds < 1) {
    std::fprintf(stderr, "usage: lens_boards_benchmark [SEEDS] | --corners FOLDER\n");
    return 2;
  }
  raysfm::tables(seeds);
  return 0;
}
