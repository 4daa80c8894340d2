#include "raysfm/boards/calibrate_boards.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "raysfm/boards/board_advice.h"
#include "raysfm/boards/view_choice.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/core/random.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

const Board kBoard{9, 6, 0.024};

Camera camera_of(const CameraModel& model) {
  Camera camera;
  camera.name = "camera";
  camera.model = model;
  camera.width = 640, camera.height = 480;
  return camera;
}

// A board held where a pixel of the camera looks, drawn evenly, turned from the ray by up to `tilt` radians
// about both axes, and about the ray.
Rigid3 held(const Camera& camera, Rng& rng, double tilt) {
  Ray ray;
  camera.ray({rng.uniform(0, camera.width), rng.uniform(0, camera.height)}, &ray);
  const Eigen::Vector3d turn(rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt), 0);
  const Eigen::Quaterniond facing =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), ray.direction);
  return {facing * exp_so3({0, 0, rng.uniform(-0.5, 0.5)}) * exp_so3(turn),
          rng.uniform(0.2, 0.45) * ray.direction};
}

// What the cameras see of a board; only those that see all of it.
BoardView seen_of(const Rig& truth, const Rigid3& rig_from_board, double noise, const std::string& name,
                  Rng& rng) {
  BoardView view;
  for (int c = 0; c < static_cast<int>(truth.cameras.size()); ++c) {
    const Camera& camera = truth.cameras[c];
    BoardImage image{c, name + "-" + std::to_string(c), {}};
    for (int i = 0; i < kBoard.corners(); ++i) {
      Eigen::Vector2d pixel;
      if (!camera.project(camera.rig_from_cam.inverse() * (rig_from_board * kBoard.corner(i)), &pixel)) break;
      if (!camera.contains(pixel)) break;
      image.pixels.push_back(pixel + noise * Eigen::Vector2d(rng.normal(), rng.normal()));
    }
    if (static_cast<int>(image.pixels.size()) == kBoard.corners()) view.push_back(image);
  }
  return view;
}

// Of `count` boards that all cameras see.
std::vector<BoardView> simulated(const Rig& truth, int count, double tilt, double noise, uint64_t seed) {
  Rng rng(seed);
  std::vector<BoardView> views;
  while (static_cast<int>(views.size()) < count) {
    const Rigid3 board = held(truth.cameras[0], rng, tilt);
    BoardView view = seen_of(truth, board, noise, "view" + std::to_string(views.size()), rng);
    if (view.size() == truth.cameras.size()) views.push_back(view);
  }
  return views;
}

std::vector<Camera> bare(const Rig& rig) {
  std::vector<Camera> cameras = rig.cameras;
  for (Camera& camera : cameras) camera.model = Pinhole{}, camera.rig_from_cam = {};
  return cameras;
}

class EveryModel : public testing::TestWithParam<CameraModel> {};

TEST_P(EveryModel, IsFoundWithinItsSigmas) {
  const Rig truth{{camera_of(GetParam())}};
  const auto views = simulated(truth, 20, 0.6, 0.1, 3);
  const std::string model(model_name(GetParam()));
  const auto found = calibrate_boards(kBoard, bare(truth), model, views);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_NEAR(found->rms_px, 0.1 * std::numbers::sqrt2, 0.01);
  EXPECT_TRUE(found->left_out.empty());
  const auto expected = camera_parameters(truth.cameras[0].model);
  const auto numbers = camera_parameters(found->problem.rig.cameras[0].model);
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(numbers[i].second, expected[i].second, 4 * found->sigmas.numbers[0][i] + 1e-12)
        << numbers[i].first;
  }
  EXPECT_LT(found->sigmas.focal[0], 0.005);
  // What no number tells by itself, rays do.
  const auto compared = compare_cameras(truth.cameras[0], found->problem.rig.cameras[0]);
  ASSERT_TRUE(compared);
  EXPECT_LT(compared->median_px, 0.35);
}

INSTANTIATE_TEST_SUITE_P(
    Boards, EveryModel,
    testing::Values(Pinhole{520, 530, 322, 236}, Radtan{520, 530, 322, 236, -0.3, 0.1, 0.001, -0.001},
                    Rational{520, 530, 322, 236, 0.1, 0.02, 0.001, -0.001, 0, 0.3, 0.05, 0},
                    KannalaBrandt{240, 241, 322, 236, 0.03, -0.01, 0.002, 0},
                    Unified{500, 505, 322, 236, 0.9, -0.05, 0.01, 0, 0},
                    DoubleSphere{300, 302, 322, 236, 0.2, 0.6}, Eucm{300, 301, 322, 236, 0.6, 1.1},
                    OCam{322, 236, 1.001, 0, 0.0005, {250, 0, -0.0012}}),
    [](const auto& info) {
      std::string name(model_name(info.param));
      std::erase(name, '-');
      return name;
    });

TEST(CalibrateBoards, ChoosesTheBetterOfTwoModels) {
  const Rig truth{{camera_of(KannalaBrandt{200, 201, 322, 236, 0.03, -0.01, 0.002, 0})}};
  const auto fisheye = calibrate_boards(kBoard, bare(truth), "auto", simulated(truth, 15, 0.8, 0.1, 3));
  ASSERT_TRUE(fisheye) << fisheye.error().message;
  EXPECT_EQ(model_name(fisheye->problem.rig.cameras[0].model), KannalaBrandt::kName);
  const Rig narrow{{camera_of(Radtan{900, 901, 322, 236, -0.1, 0.1})}};
  const auto perspective = calibrate_boards(kBoard, bare(narrow), "auto", simulated(narrow, 15, 0.6, 0.1, 3));
  ASSERT_TRUE(perspective) << perspective.error().message;
  EXPECT_EQ(model_name(perspective->problem.rig.cameras[0].model), Radtan::kName);
}

// The share of errors within two standard deviations, over many boards that are not flat: the corners of one
// image share errors, and least squares alone would be far too sure.
TEST(CalibrateBoards, SigmasCountImagesAndNotCorners) {
  const Rig truth{{camera_of(Pinhole{520, 520, 320, 240})}};
  int within = 0, all = 0;
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    auto views = simulated(truth, 15, 0.6, 0.02, seed);
    Rng rng(seed + 100);
    for (BoardView& view : views) {
      // The same stretch of all corners of an image about its middle, another in each.
      const double stretch = 0.003 * rng.normal();
      const Eigen::Vector2d middle = view[0].pixels[kBoard.corners() / 2];
      for (Eigen::Vector2d& p : view[0].pixels) p.x() += stretch * (p.x() - middle.x());
    }
    const auto found = calibrate_boards(kBoard, bare(truth), "pinhole", views);
    ASSERT_TRUE(found) << found.error().message;
    const auto numbers = camera_parameters(found->problem.rig.cameras[0].model);
    const double expected[] = {520, 520, 320, 240};
    for (int i = 0; i < 4; ++i, ++all) {
      within += std::abs(numbers[i].second - expected[i]) < 2 * found->sigmas.numbers[0][i];
    }
  }
  EXPECT_GT(within, 0.85 * all);
}

TEST(CalibrateBoards, LeavesOutAndNamesABoardThatWasMistaken) {
  const Rig truth{{camera_of(Radtan{520, 530, 322, 236, -0.3, 0.1})}};
  auto views = simulated(truth, 12, 0.6, 0.1, 5);
  std::rotate(views[4][0].pixels.begin(), views[4][0].pixels.begin() + 4, views[4][0].pixels.end());
  views[7][0].pixels[11] += Eigen::Vector2d(6, -4);
  const auto found = calibrate_boards(kBoard, bare(truth), "radtan", views);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->left_out.size(), 1U);
  EXPECT_TRUE(found->left_out[0].starts_with("view4-0")) << found->left_out[0];
  EXPECT_EQ(found->problem.observations.size(), 11U * 54 - 1);
  EXPECT_NEAR(found->rms_px, 0.1 * std::numbers::sqrt2, 0.01);
}

TEST(CalibrateBoards, ViewsThatAreAllAlikeTellNoFocalLength) {
  const Rig truth{{camera_of(Pinhole{520, 530, 322, 236})}};
  Rng rng(5);
  std::vector<BoardView> views;
  for (int v = 0; v < 12; ++v) {
    // Parallel to the image, wherever it is.
    const Rigid3 board{exp_so3({0, 0, 0.1 * v}), {0.01 * (v % 4), 0.01 * (v % 3), 0.4 + 0.01 * v}};
    views.push_back(seen_of(truth, board, 0.3, "view", rng));
    ASSERT_EQ(views.back().size(), 1U);
  }
  const auto found = calibrate_boards(kBoard, bare(truth), "pinhole", views);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().kind, ErrorKind::kNoReconstruction);
  EXPECT_NE(found.error().message.find("tilted"), std::string::npos) << found.error().message;
  const auto few = calibrate_boards(kBoard, bare(truth), "pinhole", simulated(truth, 2, 0.5, 0.1, 5));
  ASSERT_FALSE(few);
  EXPECT_EQ(few.error().kind, ErrorKind::kBadInput);
}

Rig three_cameras() {
  Rig rig{{camera_of(Radtan{500, 503, 322, 236, -0.2, 0.05}),
           camera_of(KannalaBrandt{240, 241, 318, 242, 0.02}), camera_of(Pinhole{480, 481, 315, 240})}};
  rig.cameras[1].rig_from_cam = {exp_so3({0.02, -0.1, 0.03}), {0.06, 0.01, 0.005}};
  rig.cameras[2].rig_from_cam = {exp_so3({-0.03, 0.08, 0.5}), {-0.05, 0.02, -0.01}};
  return rig;
}

TEST(CalibrateBoards, FindsWhereTheCamerasOfARigStand) {
  const Rig truth = three_cameras();
  auto views = simulated(truth, 25, 0.6, 0.1, 9);
  // The first two cameras meet in some views, the last two in others.
  for (size_t v = 0; v < views.size(); ++v) views[v].erase(views[v].begin() + (v % 2 == 0 ? 0 : 2));
  const auto found = calibrate_boards(kBoard, bare(truth), "kannala-brandt", views);
  ASSERT_TRUE(found) << found.error().message;
  for (int c = 1; c < 3; ++c) {
    const Rigid3 difference =
        found->problem.rig.cameras[c].rig_from_cam.inverse() * truth.cameras[c].rig_from_cam;
    EXPECT_LT(difference.translation.norm(), 3 * found->sigmas.pose[c].head<3>().norm());
    EXPECT_LT(rotation_angle(difference.rotation), 3 * found->sigmas.pose[c].tail<3>().norm());
    EXPECT_LT(found->sigmas.pose[c].head<3>().norm(), 0.002);
  }
}

TEST(CalibrateBoards, BoardsThatLookAlikeTurnedAreTurnedBack) {
  const Rig truth = three_cameras();
  auto views = simulated(truth, 20, 0.6, 0.0, 9);
  for (size_t v = 0; v < views.size(); ++v) {
    for (BoardImage& image : views[v]) {
      // The first six columns of the board, turned otherwise in each camera.
      std::vector<Eigen::Vector2d> kept;
      for (int i = 0; i < kBoard.corners(); ++i) {
        if (i % 9 < 6) kept.push_back(image.pixels[i]);
      }
      image.pixels.resize(36);
      const size_t turns = (v + 2 * image.camera) % 4;
      for (int i = 0; i < 36; ++i) {
        int row = i / 6, column = i % 6;
        for (size_t t = 0; t < turns; ++t) row = std::exchange(column, 5 - row);
        image.pixels[i] = kept[row * 6 + column];
      }
    }
  }
  const auto found = calibrate_boards({6, 6, 0.024}, bare(truth), "kannala-brandt", views);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(found->rms_px, 0.05);
  for (int c = 1; c < 3; ++c) {
    const Rigid3 difference =
        found->problem.rig.cameras[c].rig_from_cam.inverse() * truth.cameras[c].rig_from_cam;
    EXPECT_LT(difference.translation.norm(), 1e-3);
  }
}

TEST(CalibrateBoards, ACameraThatMeetsNoOtherIsNamed) {
  Rig truth = three_cameras();
  truth.cameras[2].name = "lonely";
  auto views = simulated(truth, 20, 0.6, 0.1, 9);
  for (size_t v = 0; v < views.size(); ++v) {
    if (v % 2 == 0) views[v].pop_back();
    if (v % 2 == 1) views[v].erase(views[v].begin(), views[v].begin() + 2);
  }
  const auto found = calibrate_boards(kBoard, bare(truth), "kannala-brandt", views);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(found.error().message.starts_with("lonely")) << found.error().message;
}

TEST(BoardAdvice, NamesWhatIsBare) {
  const Rig truth{{camera_of(Pinhole{520, 530, 322, 236})}};
  auto views = simulated(truth, 40, 0.6, 0.1, 3);
  ImageCells lit;
  lit.fill(1);
  const auto all = calibrate_boards(kBoard, bare(truth), "pinhole", views);
  ASSERT_TRUE(all);
  EXPECT_TRUE(board_advice(*all, {&lit, 1}).empty()) << board_advice(*all, {&lit, 1})[0];
  // Only boards that stay in the left three fifths.
  std::erase_if(views, [](const BoardView& view) {
    return std::ranges::any_of(view[0].pixels, [](const auto& p) { return p.x() > 383; });
  });
  const auto left = calibrate_boards(kBoard, bare(truth), "pinhole", views);
  ASSERT_TRUE(left) << left.error().message;
  const auto advice = board_advice(*left, {&lit, 1});
  const auto names = [&](const std::string& text) {
    return std::ranges::any_of(advice,
                               [&](const auto& line) { return line.find(text) != std::string::npos; });
  };
  EXPECT_TRUE(names("right side"));
  EXPECT_FALSE(names("left side"));
  for (int cell = 0; cell < static_cast<int>(lit.size()); ++cell) lit[cell] = cell % kCoverageCells < 3;
  const auto dark = board_advice(*left, {&lit, 1});
  EXPECT_FALSE(
      std::ranges::any_of(dark, [](const auto& line) { return line.find("right") != std::string::npos; }));
}

TEST(DifferingViews, LeavesOutCopies) {
  const Rig truth{{camera_of(Pinhole{520, 530, 322, 236})}};
  auto views = simulated(truth, 5, 0.6, 0.0, 3);
  views.insert(views.end(), views.begin(), views.begin() + 3);
  EXPECT_EQ(differing_views(views, 1.0, 100).size(), 5U);
  EXPECT_EQ(differing_views(views, 1.0, 4).size(), 4U);
  EXPECT_EQ(differing_views(views, 1e5, 100).size(), 1U);
}

struct RealBoards {
  std::vector<BoardView> views;
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<std::vector<cv::Point3f>> points;
  cv::Size size;
};

RealBoards real_boards(const std::filesystem::path& folder, const std::string& prefix) {
  RealBoards boards;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (!entry.path().filename().string().starts_with(prefix)) continue;
    const cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_GRAYSCALE);
    std::vector<cv::Point2f> corners;
    if (!cv::findChessboardCorners(image, {9, 6}, corners)) continue;
    cv::cornerSubPix(image, corners, {5, 5}, {-1, -1},
                     {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4});
    BoardImage own{0, entry.path().filename().string(), {}};
    std::vector<cv::Point3f> points;
    for (int i = 0; i < 54; ++i) {
      own.pixels.emplace_back(corners[i].x, corners[i].y);
      const Eigen::Vector3f x = Board{9, 6, 1}.corner(i).cast<float>();
      points.emplace_back(x.x(), x.y(), x.z());
    }
    boards.views.push_back({own});
    boards.corners.push_back(corners);
    boards.points.push_back(points);
    boards.size = image.size();
  }
  return boards;
}

// Numbers as OpenCV's within half a standard deviation, which is what the corners that are left out may
// change.
void expect_like_opencv(const BoardCalibration& found, const std::vector<double>& opencv, double rms) {
  EXPECT_NEAR(found.rms_px, rms, 0.05 * rms);
  const auto numbers = camera_parameters(found.problem.rig.cameras[0].model);
  for (size_t i = 0; i < numbers.size(); ++i) {
    EXPECT_NEAR(numbers[i].second, opencv[i], 0.5 * found.sigmas.numbers[0][i]) << numbers[i].first;
  }
}

TEST(CalibrateBoards, LikeOpenCvOnRealBoards) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("boards/pinhole-stereo");
  for (const char* side : {"left", "right"}) {
    const RealBoards boards = real_boards(testing_support::shared_data("boards/pinhole-stereo"), side);
    cv::Mat k, d;
    std::vector<cv::Mat> rotations, translations;
    const double rms =
        cv::calibrateCamera(boards.points, boards.corners, boards.size, k, d, rotations, translations);
    const auto found = calibrate_boards({9, 6, 1}, {{camera_of(Pinhole{})}}, "radtan", boards.views);
    ASSERT_TRUE(found) << found.error().message;
    std::vector<double> opencv = {k.at<double>(0, 0), k.at<double>(1, 1), k.at<double>(0, 2),
                                  k.at<double>(1, 2)};
    opencv.insert(opencv.end(), d.ptr<double>(), d.ptr<double>() + 5);
    expect_like_opencv(*found, opencv, rms);
  }
}

TEST(CalibrateBoards, LikeOpenCvOnRealBoardsOfAFisheye) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("boards/fisheye-stereo");
  for (const char* side : {"left", "right"}) {
    const RealBoards boards = real_boards(testing_support::shared_data("boards/fisheye-stereo"), side);
    cv::Mat k = (cv::Mat_<double>(3, 3) << 230, 0, 480, 0, 230, 300, 0, 0, 1),
            d = cv::Mat::zeros(4, 1, CV_64F);
    std::vector<cv::Mat> rotations, translations;
    const int flags = cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW |
                      cv::fisheye::CALIB_USE_INTRINSIC_GUESS;
    const double rms =
        cv::fisheye::calibrate(boards.points, boards.corners, boards.size, k, d, rotations, translations,
                               flags, {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-9});
    Camera camera = camera_of(Pinhole{});
    camera.width = boards.size.width, camera.height = boards.size.height;
    const auto found = calibrate_boards({9, 6, 1}, {{camera}}, "kannala-brandt", boards.views);
    ASSERT_TRUE(found) << found.error().message;
    std::vector<double> opencv = {k.at<double>(0, 0), k.at<double>(1, 1), k.at<double>(0, 2),
                                  k.at<double>(1, 2)};
    opencv.insert(opencv.end(), d.ptr<double>(), d.ptr<double>() + 4);
    expect_like_opencv(*found, opencv, rms);
  }
}

}  // namespace
}  // namespace raysfm
