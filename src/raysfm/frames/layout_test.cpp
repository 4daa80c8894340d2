#include "raysfm/frames/layout.h"

#include <gtest/gtest.h>

#include "support/camera_texts.h"
#include "support/image_files.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using namespace testing_support;

constexpr const char* kSmallCamera =
    "raysfm_camera: 1\ncameras: [{name: c, model: pinhole, resolution: [32, 24], intrinsics: {fx: 30, fy: "
    "30, cx: 15, "
    "cy: 11}}]\n";

Result<Input> open(const fs::path& path, InputOptions options = {}) {
  return open_input({path.string()}, options);
}

std::string message_of(const Result<Input>& input) {
  EXPECT_FALSE(input);
  if (input) return {};
  EXPECT_EQ(input.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(input.error().message.find('\n'), std::string::npos);
  return input.error().message;
}

void expect_says(const std::string& message, const std::string& part) {
  EXPECT_NE(message.find(part), std::string::npos) << message << " lacks " << part;
}

// Reads to the end; the error if there is one.
Result<std::vector<InputFrame>> read_all(FrameSource& source) {
  std::vector<InputFrame> frames;
  for (;;) {
    Result<std::optional<InputFrame>> frame = source.next();
    if (!frame) return frame.error();
    if (!*frame) return frames;
    frames.push_back(std::move(**frame));
  }
}

TEST(Layout, PlainFolderCountsOrDividesByFps) {
  const TemporaryFolder folder;
  write_images(folder.path(), 12);
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->layout, "images");
  EXPECT_FALSE(input->calibration || input->truth || input->mask);
  EXPECT_TRUE(input->times_are_indices);
  ASSERT_EQ(input->streams.size(), 1u);
  EXPECT_EQ(input->streams[0]->width(), 32);
  EXPECT_EQ(input->streams[0]->frame_count(), 12);
  const auto frames = read_all(*input->streams[0]);
  ASSERT_TRUE(frames);
  ASSERT_EQ(frames->size(), 12u);
  for (int i = 0; i < 12; ++i) {
    const InputFrame& frame = (*frames)[i];
    EXPECT_EQ(frame.index, i);
    EXPECT_EQ(frame.timestamp, i);
    EXPECT_EQ(frame.name, std::to_string(i) + ".png");
    EXPECT_TRUE(same_pixels(frame.gray, pattern(32, 24, i))) << i;
    EXPECT_TRUE(frame.colors.empty());
  }
  Result<Input> timed = open(folder.path(), {.fps = 4});
  ASSERT_TRUE(timed);
  EXPECT_EQ(read_all(*timed->streams[0])->at(3).timestamp, 0.75);
  EXPECT_FALSE(timed->times_are_indices);
  const std::string pattern_of_names = (folder.path() / "*.png").string();
  EXPECT_TRUE(open(pattern_of_names)->times_are_indices);
  EXPECT_FALSE(open(pattern_of_names, {.fps = 4})->times_are_indices);
}

TEST(Layout, SequenceOfOneCamera) {
  const TemporaryFolder folder;
  write_images(folder.path() / "images", 3);
  folder.file("times.txt", "# seconds\n0.5\n\n1.5e0\n2.25\n");
  folder.file("camera.yaml", kSmallCamera);
  folder.file("truth.txt", "");
  folder.file("mask.png", "");
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->layout, "sequence");
  ASSERT_TRUE(input->calibration);
  EXPECT_EQ(input->calibration->cameras[0].name, "c");
  EXPECT_EQ(*input->calibration_file, folder.path() / "camera.yaml");
  EXPECT_EQ(*input->truth, folder.path() / "truth.txt");
  EXPECT_EQ(*input->mask, folder.path() / "mask.png");
  const auto frames = read_all(*input->streams[0]);
  ASSERT_TRUE(frames);
  EXPECT_EQ(frames->at(2).timestamp, 2.25);
  EXPECT_FALSE(input->times_are_indices);
}

TEST(Layout, ACalibrationThatIsIgnoredMayBeBroken) {
  const TemporaryFolder folder;
  write_images(folder.path() / "images", 2);
  folder.file("camera.yaml", "raysfm_camera: 1\ncameras: [{name: c, model: unheard-of}]\n");
  expect_says(message_of(open(folder.path())), "unheard-of");
  const Result<Input> input = open(folder.path(), {.ignore_calibration = true});
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_FALSE(input->calibration);
  EXPECT_TRUE(input->calibration_file);
}

TEST(Layout, SequenceOfARig) {
  const TemporaryFolder folder;
  for (int camera = 0; camera < 11; ++camera)
    write_images(folder.path() / ("cam" + std::to_string(camera)), 2);
  folder.file("times.txt", "0\n1\n");
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->streams.size(), 11u);
  EXPECT_EQ(open(folder.path(), {.mono = true})->streams.size(), 1u);
  fs::remove(folder.path() / "cam10" / "1.png");
  expect_says(message_of(open(folder.path())), "cam10");
}

TEST(Layout, Kitti) {
  const TemporaryFolder folder;
  for (int camera = 0; camera < 4; ++camera)
    write_images(folder.path() / ("image_" + std::to_string(camera)), 2);
  folder.file("times.txt", "0.0\n1.0e-01\n");
  folder.file("calib.txt", kKittiText);
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->layout, "kitti");
  EXPECT_EQ(input->streams.size(), 2u);
  ASSERT_EQ(input->calibration->cameras.size(), 2u);
  EXPECT_NEAR(input->calibration->cameras[1].rig_from_cam.translation.x(), 0.5, 1e-12);
  // The size comes from the images.
  EXPECT_EQ(input->calibration->cameras[1].width, 32);
  EXPECT_EQ(input->calibration->cameras[1].height, 24);
  EXPECT_EQ(open(folder.path(), {.mono = true})->calibration->cameras.size(), 1u);

  fs::remove_all(folder.path() / "image_0");
  folder.file("calib.txt", kKittiText + "P3: 7e2 0 6e2 -3.03e2 0 7e2 1.8e2 0 0 0 1 0\n");
  Result<Input> colour = open(folder.path());
  ASSERT_TRUE(colour) << colour.error().message;
  // The rig is the first camera in use: camera 2.
  EXPECT_EQ(colour->calibration->cameras[0].name, "image_2");
  EXPECT_EQ(colour->calibration->cameras[0].stream, 0);
  EXPECT_LT(colour->calibration->cameras[0].rig_from_cam.translation.norm(), 1e-12);
  EXPECT_GT(colour->calibration->cameras[1].rig_from_cam.translation.x(), 0.4);
}

TEST(Layout, EurocPairsFramesByTime) {
  const TemporaryFolder folder;
  for (const char* camera : {"cam0", "cam1"}) {
    fs::create_directories(folder.path() / "mav0" / camera);
    fs::rename(write_images(folder.path() / "tmp", 3), folder.path() / "mav0" / camera / "data");
    folder.file(std::string("mav0/") + camera + "/sensor.yaml", kEurocYaml);
  }
  const std::string head = "#timestamp [ns],filename\r\n";
  folder.file(
      "mav0/cam0/data.csv",
      head + "1403636579763555584,0.png\r\n1403636579813555456,1.png\r\n1403636579863555584,2.png\r\n");
  folder.file("mav0/cam1/data.csv", head + "1403636579763555584,0.png\r\n1403636579863555584,2.png\r\n");
  const std::string message = message_of(open(folder.path()));
  expect_says(message, "752 x 480");  // the images of this test are smaller
  expect_says(message, "sensor.yaml");
  Result<Input> input = open(folder.path(), {.ignore_calibration = true});
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->layout, "euroc");
  ASSERT_EQ(input->streams.size(), 2u);
  for (const auto& stream : input->streams) {
    const auto frames = read_all(*stream);
    ASSERT_TRUE(frames);
    ASSERT_EQ(frames->size(), 2u);
    EXPECT_EQ(frames->at(1).name, "2.png");
    EXPECT_NEAR(frames->at(1).timestamp, 1403636579.863555584, 1e-6);
  }
  EXPECT_EQ(read_all(*open(folder.path(), {.mono = true, .ignore_calibration = true})->streams[0])->size(),
            3u);
  folder.file("mav0/cam1/data.csv", head + "1403636579763555585,0.png\n");
  expect_says(message_of(open(folder.path())), "all 2 cameras");
  folder.file("mav0/cam1/data.csv", head + "1403636579763555584 0.png\n");
  folder.file("mav0/cam1/data.csv", head + "12x,0.png\n");
  expect_says(message_of(open(folder.path())), "line 2");
}

TEST(Layout, TumListsItsImages) {
  const TemporaryFolder folder;
  write_images(folder.path() / "rgb", 3);
  folder.file("rgb.txt", "# color images\n1305031229.5287 rgb/2.png\n1305031229.5644 rgb/0.png\n");
  folder.file("groundtruth.txt", "");
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(input->layout, "tum-rgbd");
  EXPECT_EQ(*input->truth, folder.path() / "groundtruth.txt");
  const auto frames = read_all(*input->streams[0]);
  ASSERT_EQ(frames->size(), 2u);
  EXPECT_EQ(frames->at(0).name, "2.png");
  EXPECT_EQ(frames->at(1).timestamp, 1305031229.5644);
  folder.file("rgb.txt", "1 rgb/2.png\n2 rgb/7.png\n");
  expect_says(message_of(open(folder.path())), "7.png");
}

TEST(Layout, BadTimesNameTheLine) {
  const TemporaryFolder folder;
  write_images(folder.path() / "images", 3);
  const auto times = [&](const std::string& text) {
    folder.file("times.txt", text);
    return message_of(open(folder.path()));
  };
  expect_says(times("0\n1\n"), "2 lines");
  expect_says(times("0\n1\n2\n3\n"), "4 lines");
  expect_says(times(""), "no line");
  expect_says(times("0\n1\n1\n"), "line 3: timestamp 1");
  expect_says(times("0\n2\n1\n"), "line 3: timestamp 1");
  expect_says(times("0\nnan\n1\n"), "line 2: timestamp 'nan'");
  expect_says(times("0\ninf\n1\n"), "line 2: timestamp 'inf'");
  expect_says(times("0\nx\n1\n"), "line 2: timestamp 'x'");
  expect_says(times("0\n1 2\n3\n"), "line 2");
}

TEST(Layout, BadImagesAreNamed) {
  const TemporaryFolder folder;
  const fs::path images = write_images(folder.path() / "images", 4);
  cv::imwrite((images / "2.png").string(), pattern(30, 24, 0));
  Result<Input> input = open(folder.path());
  ASSERT_TRUE(input);
  Result<std::vector<InputFrame>> frames = read_all(*input->streams[0]);
  ASSERT_TRUE(frames);
  ASSERT_EQ(frames->size(), 4u);
  for (const char* said : {"2.png", "30 x 24", "32 x 24"}) expect_says(frames->at(2).defect, said);
  for (const int i : {0, 1, 3}) EXPECT_EQ(frames->at(i).defect, "");

  folder.file("images/2.png", "damaged");
  input = open(folder.path());
  ASSERT_TRUE(input);
  frames = read_all(*input->streams[0]);
  ASSERT_TRUE(frames);
  expect_says(frames->at(2).defect, "2.png");
  for (const char* name : {"images/0.png", "images/1.png", "images/3.png"}) folder.file(name, "damaged");
  expect_says(message_of(open(folder.path())), "0.png");
}

TEST(OpenInput, RefusesWhatIsNoInput) {
  const TemporaryFolder folder;
  expect_says(message_of(open(folder.path() / "missing")), "no such file");
  expect_says(message_of(open(folder.path())), "no image");
  expect_says(message_of(open(folder.path() / "*.png")), "pattern");
  expect_says(message_of(open(folder.path() / "no" / "*.png")), "cannot be read");
  expect_says(message_of(open(folder.file("text.txt", "hello\n"))), "no video");
  expect_says(message_of(open(folder.file("empty.mp4", ""))), "no video");
  expect_says(message_of(open("/dev/video99")), "/dev/video99");
  expect_says(message_of(open_input({}, {})), "no input");
  expect_says(message_of(open(folder.path(), {.fps = -1})), "fps");
  fs::create_directories(folder.path() / "images");
  expect_says(message_of(open(folder.path())), "no image");
}

TEST(OpenInput, AFolderOfAVideoSaysToTakeTheVideo) {
  const TemporaryFolder folder;
  folder.file("notes.txt", "");
  expect_says(message_of(open(folder.path())), "no image; allowed: at least one PNG");
  folder.file("b.MOV", "");
  expect_says(message_of(open(folder.path())), "b.MOV");
  folder.file("a.mp4", "");
  expect_says(message_of(open(folder.path())), "a.mp4");
}

TEST(OpenInput, SeveralInputsAreStreams) {
  const TemporaryFolder folder;
  const fs::path left = write_images(folder.path() / "left", 3),
                 right = write_images(folder.path() / "right", 3, 16, 12);
  folder.file("left/camera.yaml", kSmallCamera);
  const Result<Input> input = open_input({left.string(), (right / "?.png").string()}, {});
  ASSERT_TRUE(input) << input.error().message;
  ASSERT_EQ(input->streams.size(), 2u);
  EXPECT_EQ(input->streams[1]->width(), 16);
  EXPECT_FALSE(input->calibration);
  EXPECT_TRUE(open_input({left.string()}, {})->calibration);
  EXPECT_EQ(open_input({(left / "1.png").string()}, {})->streams[0]->frame_count(), 1);
  expect_says(message_of(open_input({left.string(), (right / "1.png").string()}, {})), "1 images; allowed");
}

// A rig's folder gives every stream with its camera; cameras without a stream, or of another size, are named.
TEST(OpenInput, ARigNeedsAllItsStreams) {
  const TemporaryFolder folder;
  for (const char* name : {"cam0", "cam1"}) write_images(folder.path() / name, 3);
  const auto camera = [](const std::string& name, int stream, const std::string& size) {
    return "  - {name: " + name + ", model: pinhole, resolution: " + size +
           ", intrinsics: {fx: 30, fy: 30, cx: 16, cy: 12}, stream: " + std::to_string(stream) + "}\n";
  };
  const std::string head = "raysfm_camera: 1\ncameras:\n", size = "[32, 24]";
  const auto with_cameras = [&](const std::string& cameras, bool mono = false) {
    folder.file("camera.yaml", head + cameras);
    return open(folder.path(), {.mono = mono});
  };
  const Result<Input> pair = with_cameras(camera("a", 0, size) + camera("b", 1, size));
  ASSERT_TRUE(pair) << pair.error().message;
  EXPECT_EQ(pair->streams.size(), 2u);
  EXPECT_EQ(pair->calibration->cameras.size(), 2u);
  const Result<Input> mono = with_cameras(camera("a", 0, size) + camera("b", 1, size), true);
  ASSERT_TRUE(mono) << mono.error().message;
  EXPECT_EQ(mono->streams.size(), 1u);
  EXPECT_EQ(mono->calibration->cameras.size(), 1u);
  expect_says(message_of(with_cameras(camera("a", 0, size) + camera("b", 2, size))), "camera b: stream: 2");
  expect_says(message_of(with_cameras(camera("a", 0, size))), "no camera");
  expect_says(message_of(with_cameras(camera("a", 0, size) + camera("b", 1, "[30, 24]"))),
              "camera b: resolution: 30 x 24");
  fs::remove(folder.path() / "cam1" / "2.png");
  expect_says(message_of(with_cameras(camera("a", 0, size) + camera("b", 1, size))), "2 images");
}

TEST(RigForStreams, FitsTheRigToWhatIsThere) {
  const TemporaryFolder folder;
  const fs::path images = write_images(folder.path() / "images", 1);
  const Result<Input> input = open(images);
  ASSERT_TRUE(input);
  Rig rig;
  rig.cameras.resize(2);
  rig.cameras[0].name = "near";
  rig.cameras[1].name = "far";
  rig.cameras[1].stream = 1;
  std::string note;
  const Result<Rig> fitted = rig_for_streams(rig, input->streams, &note, true);
  ASSERT_TRUE(fitted) << fitted.error().message;
  ASSERT_EQ(fitted->cameras.size(), 1u);
  EXPECT_EQ(fitted->cameras[0].height, 24);
  expect_says(note, "far");
  expect_says(rig_for_streams(rig, input->streams, nullptr).error().message, "camera far: stream: 1");

  rig.cameras.resize(1);
  rig.cameras[0].width = 31;
  rig.cameras[0].height = 24;
  expect_says(rig_for_streams(rig, input->streams, nullptr).error().message, "31 x 24; allowed: the 32 x 24");
  rig.cameras[0].roi = {1, 0, 31, 24};
  EXPECT_TRUE(rig_for_streams(rig, input->streams, nullptr));
  rig.cameras[0].roi = {2, 0, 31, 24};
  expect_says(rig_for_streams(rig, input->streams, nullptr).error().message, "roi");
  rig.cameras[0].stream = 1;
  expect_says(rig_for_streams(rig, input->streams, nullptr, true).error().message, "no camera");
}

TEST(SharedSequences, OpenWithTheirCalibration) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("kitti07-mono");
  struct Sequence {
    const char* folder;
    const char* layout;
    int width, height, count;
    size_t streams;
    double first, last;
  };
  const Sequence sequences[] = {
      {"kitti07-mono", "kitti", 1226, 370, 100, 1, 0, 10.29001},
      {"kitti06-stereo", "kitti", 1226, 370, 31, 2, 0, 3.0},
      {"fr1-rpy", "tum-rgbd", 640, 480, 160, 1, 1305031229.528748, 1305031234.829772},
      {"tsukuba-mono", "sequence", 640, 480, 100, 1, 0, 3.3},
      {"temple-ring", "sequence", 640, 480, 19, 1, 0, 18},
      {"rendered/tri-rig", "sequence", 400, 300, 40, 3, 0, 3.9},
  };
  for (const Sequence& expected : sequences) {
    Result<Input> input = open(shared_data(expected.folder));
    ASSERT_TRUE(input) << input.error().message;
    EXPECT_EQ(input->layout, expected.layout);
    EXPECT_TRUE(input->truth);
    ASSERT_EQ(input->streams.size(), expected.streams);
    ASSERT_TRUE(input->calibration);
    EXPECT_EQ(input->calibration->cameras.size(), expected.streams);
    const auto frames = read_all(*input->streams.back());
    ASSERT_TRUE(frames) << frames.error().message;
    ASSERT_EQ(static_cast<int>(frames->size()), expected.count);
    EXPECT_EQ(frames->front().gray.width(), expected.width);
    EXPECT_EQ(frames->front().gray.height(), expected.height);
    EXPECT_NEAR(frames->front().timestamp, expected.first, 1e-5);
    EXPECT_NEAR(frames->back().timestamp, expected.last, 1e-5);
  }
}

}  // namespace
}  // namespace raysfm
