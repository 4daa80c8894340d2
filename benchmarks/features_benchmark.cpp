// Times the front end beside OpenCV on one core, and measures the accuracy of the alignment.
// features_benchmark [FIRST SECOND]: two images; without them, pairs of the shared data.
#include <algorithm>
#include <cstdio>
#include <functional>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <string>
#include <vector>

#include "raysfm/core/timer.h"
#include "raysfm/features/coarse_rotation.h"
#include "raysfm/features/feature_grid.h"
#include "raysfm/features/harris.h"
#include "raysfm/features/patch_alignment.h"
#include "raysfm/features/patches.h"
#include "raysfm/features/zncc_matcher.h"
#include "raysfm/image/blur.h"
#include "raysfm/image/pyramid.h"
#include "support/instruction_sets.h"
#include "support/shared_data.h"
#include "support/texture.h"

namespace raysfm {
namespace {

GrayView view(const cv::Mat& m) {
  return {m.data, m.cols, m.rows, static_cast<ptrdiff_t>(m.step)};
}

cv::Mat as_mat(const GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8U, const_cast<uint8_t*>(image.row(0)),
                 image.view().stride);
}

std::vector<cv::Point2f> as_points(const std::vector<Eigen::Vector2f>& pixels) {
  std::vector<cv::Point2f> points;
  for (const auto& p : pixels) points.emplace_back(p.x(), p.y());
  return points;
}

// Median of many runs, milliseconds.
double median_ms(const std::function<void()>& work) {
  constexpr int kRuns = 51;
  work();
  std::vector<double> times;
  for (int i = 0; i < kRuns; ++i) {
    const auto start = Clock::now();
    work();
    times.push_back(milliseconds_since(start));
  }
  std::nth_element(times.begin(), times.begin() + kRuns / 2, times.end());
  return times[kRuns / 2];
}

void print_row(const char* stage, double ours, const std::string& what, const char* rival = "",
               double theirs = 0) {
  std::printf("  %-34s %8.3f  %-22s", stage, ours, what.c_str());
  if (theirs > 0) std::printf(" | %-30s %8.3f  %5.1fx", rival, theirs, theirs / ours);
  std::printf("\n");
}

std::string count_of(size_t n, const char* noun) {
  return std::to_string(n) + " " + noun;
}

// Two frames and everything that the stages hand on.
struct Pair {
  cv::Mat first, second;
  Features a, b;
  PatchSet patches_a, patches_b;
  FeatureGrid grid;
  std::vector<ZnccMatch> matches;
  std::vector<Eigen::Vector2f> from, to;

  Pair(const cv::Mat& first_image, const cv::Mat& second_image) : first(first_image), second(second_image) {
    HarrisDetector detector;
    detector.detect(view(first), {}, &a);
    detector.detect(view(second), {}, &b);
    extract_patches(view(first), a.pixels, &patches_a);
    extract_patches(view(second), b.pixels, &patches_b);
    grid.build(b.pixels, second.cols, second.rows);
    match(30);
    for (const ZnccMatch& m : matches) {
      from.push_back(a.pixels[m.query]);
      to.push_back(b.pixels[m.train]);
    }
  }

  void match(float radius) {
    ZnccMatcher matcher;
    const std::vector<float> radii(a.pixels.size(), radius);
    matcher.match(patches_a, a.pixels, radii, patches_b, b.pixels, grid, {}, &matches);
  }
};

double time_detection(const Pair& pair) {
  HarrisDetector detector;
  Features features;
  const double ours = median_ms([&] { detector.detect(view(pair.first), {}, &features); });
  const std::string found = count_of(static_cast<size_t>(features.size()), "corners");
  cv::Mat response;
  print_row("detection", ours, found, "cornerHarris (no maxima)",
            median_ms([&] { cv::cornerHarris(pair.first, response, 5, 3, 0.04); }));
  std::vector<cv::Point2f> corners;
  const double good = median_ms(
      [&] { cv::goodFeaturesToTrack(pair.first, corners, 1500, 1e-4, 3, cv::noArray(), 5, true, 0.04); });
  print_row("", ours, "", "goodFeaturesToTrack, Harris", good);
  std::vector<cv::KeyPoint> keypoints;
  const double fast = median_ms([&] { cv::FAST(pair.first, keypoints, 10); });
  print_row("", ours, "", ("FAST(10), " + count_of(keypoints.size(), "corners")).c_str(), fast);
  return ours;
}

double time_matching(Pair& pair) {
  PatchSet patches;
  double total = median_ms([&] { extract_patches(view(pair.first), pair.a.pixels, &patches); });
  print_row("patches", total, count_of(pair.a.pixels.size(), "patches"));
  Eigen::Matrix2f warp;
  warp << 1.1f, 0.1f, -0.1f, 0.95f;
  const std::vector<Eigen::Matrix2f> warps(pair.a.pixels.size(), warp);
  print_row("warped patches",
            median_ms([&] { extract_warped_patches(view(pair.first), pair.a.pixels, warps, &patches); }), "");
  for (const float radius : {20.0f, 30.0f, 40.0f}) {
    const double ms = median_ms([&] { pair.match(radius); });
    print_row(("matching, radius " + std::to_string(static_cast<int>(radius))).c_str(), ms,
              count_of(pair.matches.size(), "matches"));
    if (radius == 30) total += ms;
  }
  return total;
}

double time_alignment(const Pair& pair) {
  const size_t count = std::min<size_t>(800, pair.from.size());
  const std::vector<Eigen::Vector2f> from(pair.from.begin(),
                                          pair.from.begin() + static_cast<ptrdiff_t>(count));
  const std::vector<Eigen::Vector2f> to(pair.to.begin(), pair.to.begin() + static_cast<ptrdiff_t>(count));
  const std::vector<Eigen::Matrix2f> identity(count, Eigen::Matrix2f::Identity());
  std::vector<PatchAlignment> aligned(count);
  const PatchAligner aligner;
  const double ours =
      median_ms([&] { aligner.align(view(pair.first), from, identity, view(pair.second), to, aligned); });
  const auto p = as_points(from);
  std::vector<unsigned char> status;
  std::vector<float> error;
  const cv::TermCriteria stop(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 10, 0.02);
  const double theirs = median_ms([&] {
    auto q = as_points(to);
    cv::calcOpticalFlowPyrLK(pair.first, pair.second, p, q, status, error, {11, 11}, 0, stop,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
  });
  print_row("alignment", ours, count_of(count, "patches"), "calcOpticalFlowPyrLK, 1 level", theirs);
  return ours;
}

void time_pair(const std::string& title, const cv::Mat& first, const cv::Mat& second) {
  std::printf("\n%s, %d x %d\n", title.c_str(), first.cols, first.rows);
  Pair pair(first, second);
  const double frame = time_detection(pair) + time_matching(pair) + time_alignment(pair);
  print_row("frame: the three stages above", frame, "");
  GrayImage small, other;
  cv::Mat rival;
  print_row("blur 3 x 3", median_ms([&] { blur3(view(first), &small); }), "", "GaussianBlur 3 x 3",
            median_ms([&] {
              cv::GaussianBlur(first, rival, {3, 3}, 0);
            }));
  print_row("half size", median_ms([&] { half_sample(view(first), &small); }), "", "resize, INTER_AREA",
            median_ms([&] {
              cv::resize(first, rival, {first.cols / 2, first.rows / 2}, 0, 0, cv::INTER_AREA);
            }));
  print_row("thumbnail", median_ms([&] { make_thumbnail(view(first), 80, &small); }), "");
  const int side = make_thumbnail(view(second), 80, &other);
  CoarseMotion motion;
  const double coarse = median_ms(
      [&] { motion = estimate_coarse_motion(small.view(), other.view(), static_cast<float>(side)); });
  char text[64];
  std::snprintf(text, sizeof text, "zncc %.2f", motion.zncc);
  print_row("coarse motion", coarse, text);
}

double rms(const std::vector<Eigen::Vector2d>& errors) {
  double sum = 0;
  for (const auto& e : errors) sum += e.squaredNorm() / 2;
  return std::sqrt(sum / static_cast<double>(errors.size()));
}

// Errors per coordinate over a band-limited texture that moved by a known fraction of a pixel.
void measure_alignment(double sigma) {
  const testing_support::Texture texture(2, 6, 40, 30);
  const Eigen::Vector2d shift(0.3, -0.2);
  const GrayImage first = testing_support::render(
      texture, 640, 480, [](const Eigen::Vector2d& p) { return p; }, 1, 0, sigma, 1);
  const GrayImage second = testing_support::render(
      texture, 640, 480, [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p - shift; }, 1, 0, sigma,
      2);
  Features features;
  HarrisDetector().detect(first.view(), {}, &features);
  const std::vector<Eigen::Matrix2f> identity(features.pixels.size(), Eigen::Matrix2f::Identity());
  std::vector<PatchAlignment> aligned(features.pixels.size());
  PatchAligner().align(first.view(), features.pixels, identity, second.view(), features.pixels, aligned);
  const auto p = as_points(features.pixels);
  auto q = p;
  std::vector<unsigned char> status;
  std::vector<float> unused;
  cv::calcOpticalFlowPyrLK(as_mat(first), as_mat(second), p, q, status, unused, {11, 11}, 0,
                           {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.005},
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<Eigen::Vector2d> ours, theirs;
  for (size_t i = 0; i < p.size(); ++i) {
    if (!aligned[i].converged || !status[i]) continue;
    ours.push_back((aligned[i].pixel - features.pixels[i]).cast<double>() - shift);
    theirs.push_back(Eigen::Vector2d(q[i].x - p[i].x, q[i].y - p[i].y) - shift);
  }
  std::printf("  noise %.0f grey levels: rms %.4f px, calcOpticalFlowPyrLK %.4f px (%zu of %zu patches)\n",
              sigma, rms(ours), rms(theirs), ours.size(), p.size());
}

void run(int argc, char** argv) {
  struct Frames {
    const char* title;
    std::string first, second;
  };
  const auto shared = [](const char* name) { return testing_support::shared_data(name).string(); };
  std::vector<Frames> pairs{
      {"kitchen", shared("redkitchen-handheld/images/000100.jpg"),
       shared("redkitchen-handheld/images/000102.jpg")},
      {"tsukuba", shared("tsukuba-mono/images/000010.jpg"), shared("tsukuba-mono/images/000011.jpg")},
      {"car", shared("kitti07-mono/image_0/000010.png"), shared("kitti07-mono/image_0/000011.png")}};
  if (argc == 3) pairs = {{"images", argv[1], argv[2]}};
  testing_support::for_each_instruction_set([&](const std::string& name) {
    if (name != "AVX2" && name != "AVX3") return;
    std::printf("\n== %s, one thread, milliseconds ==\n", name.c_str());
    for (const Frames& frames : pairs) {
      const cv::Mat first = cv::imread(frames.first, cv::IMREAD_GRAYSCALE);
      const cv::Mat second = cv::imread(frames.second, cv::IMREAD_GRAYSCALE);
      if (first.empty() || second.empty()) {
        std::printf("\n%s: cannot read %s or %s\n", frames.title, frames.first.c_str(),
                    frames.second.c_str());
        continue;
      }
      time_pair(frames.title, first, second);
    }
  });
  std::printf("\nalignment of a texture that moved by (0.3, -0.2) pixels\n");
  for (const double sigma : {0.0, 2.0, 4.0}) measure_alignment(sigma);
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  raysfm::run(argc, argv);
}
