#include "raysfm/frames/image_source.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "raysfm/frames/image_file.h"
#include "support/image_files.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using namespace testing_support;

TEST(NaturalLess, NumbersCompareAsNumbers) {
  const std::vector<std::string> order = {"",  "0",  "01",   "1",     "2",   "10",
                                          "a", "a1", "a2b1", "a2b10", "a10", "b"};
  for (size_t i = 0; i < order.size(); ++i) {
    for (size_t j = 0; j < order.size(); ++j) {
      EXPECT_EQ(natural_less(order[i], order[j]), i < j) << order[i] << " " << order[j];
    }
  }
  EXPECT_TRUE(natural_less("9", "99999999999999999999999999"));
}

TEST(ImageFile, DecodesEveryFormatWhateverItsName) {
  const TemporaryFolder folder;
  const cv::Mat expected = pattern(33, 17, 1);
  for (const char* extension : {".png", ".bmp", ".tiff", ".pgm", ".webp", ".jpg"}) {
    const auto path = folder.path() / (std::string("image") + extension);
    const bool lossy = extension == std::string(".jpg") || extension == std::string(".webp");
    cv::imwrite(path.string(), lossy ? cv::Mat(17, 33, CV_8U, cv::Scalar(90)) : expected);
    std::filesystem::rename(path, folder.path() / "renamed");
    EXPECT_TRUE(is_image_file(folder.path() / "renamed")) << extension;
    const Result<DecodedImage> image = read_image(folder.path() / "renamed");
    ASSERT_TRUE(image) << image.error().message;
    ASSERT_EQ(image->gray.width(), 33);
    if (lossy) {
      EXPECT_NEAR(image->gray.row(8)[16], 90, 2) << extension;
    } else {
      EXPECT_TRUE(same_pixels(image->gray, expected)) << extension;
      EXPECT_TRUE(image->colors.empty() || extension == std::string(".bmp"));
    }
  }
}

TEST(ImageFile, ColourGivesGreyAndColours) {
  const TemporaryFolder folder;
  cv::Mat colour(5, 7, CV_8UC3);
  colour.setTo(cv::Scalar(10, 100, 200));
  colour.at<cv::Vec3b>(2, 3) = {255, 0, 0};
  const auto path = folder.path() / "c.png";
  cv::imwrite(path.string(), colour);
  const Result<DecodedImage> image = read_image(path);
  ASSERT_TRUE(image);
  EXPECT_NEAR(image->gray.row(0)[0], 0.299 * 200 + 0.587 * 100 + 0.114 * 10, 1);
  EXPECT_NEAR(image->gray.row(2)[3], 0.114 * 255, 1);
  EXPECT_EQ(image->colors.at(0, 0, 0), (std::array<uint8_t, 3>{200, 100, 10}));
  EXPECT_EQ(image->colors.at(3, 2, 0), (std::array<uint8_t, 3>{0, 0, 255}));
}

TEST(ImageFile, SixteenBitsAreScaledToEight) {
  const TemporaryFolder folder;
  cv::Mat deep(1, 3, CV_16U);
  deep.at<uint16_t>(0, 0) = 65535;
  deep.at<uint16_t>(0, 1) = 257 * 100;
  deep.at<uint16_t>(0, 2) = 100;
  cv::imwrite((folder.path() / "deep.png").string(), deep);
  const Result<DecodedImage> image = read_image(folder.path() / "deep.png");
  ASSERT_TRUE(image);
  EXPECT_EQ(image->gray.row(0)[0], 255);
  EXPECT_EQ(image->gray.row(0)[1], 100);
  EXPECT_EQ(image->gray.row(0)[2], 0);
}

TEST(ImageFile, DamagedFilesAreNamed) {
  const TemporaryFolder folder;
  for (const char* extension : {".png", ".jpg", ".bmp", ".pgm"}) {
    const auto whole = folder.path() / (std::string("whole") + extension);
    cv::imwrite(whole.string(), pattern(64, 48, 3));
    const std::string bytes = content_of(whole);
    const auto cut = folder.file(std::string("cut") + extension, bytes.substr(0, bytes.size() / 2));
    const Result<DecodedImage> image = read_image(cut);
    ASSERT_FALSE(image) << extension;
    EXPECT_NE(image.error().message.find(cut.string()), std::string::npos);
  }
  EXPECT_FALSE(read_image(folder.file("text.png", "no image")));
  EXPECT_FALSE(read_image(folder.file("empty.png", "")));
  EXPECT_FALSE(read_image(folder.path() / "missing.png"));
  EXPECT_FALSE(read_image(folder.path()));
  // A header that promises 2^31 x 2^31 pixels.
  EXPECT_FALSE(read_image(folder.file("huge.pgm", "P5\n2147483647 2147483647\n255\n")));
}

// libpng would print what it thinks of a PNG file.
TEST(ImageFile, PngIsReadInSilence) {
  const TemporaryFolder folder;
  const cv::Mat image = pattern(32, 24, 1);
  std::vector<uint8_t> encoded;
  cv::imencode(".png", image, encoded);
  const std::string png(encoded.begin(), encoded.end());
  const size_t header = 8 + 12 + 13;  // signature and IHDR

  testing::internal::CaptureStderr();
  const std::string profile("\0\0\0\4iCCPoops\0\0\0\0", 16);  // no profile, no checksum
  const std::string odd = png.substr(0, header) + profile + png.substr(header);
  const Result<DecodedImage> read = read_image(folder.file("odd.png", odd));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(same_pixels(read->gray, image));
  for (size_t i = 8; i < png.size(); ++i) {
    std::string damaged = png;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    const Result<DecodedImage> refused = read_image(folder.file("damaged.png", damaged));
    EXPECT_TRUE(!refused || same_pixels(refused->gray, image)) << "byte " << i;
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(ImageFile, MasksAreBlackAndWhiteAndOfTheRightSize) {
  const TemporaryFolder folder;
  cv::Mat mask(4, 6, CV_8U, cv::Scalar(127));
  mask.at<uint8_t>(1, 2) = 128;
  const auto path = folder.path() / "mask.png";
  cv::imwrite(path.string(), mask);
  const Result<GrayImage> read = read_mask(path, 6, 4);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->row(1)[2], 255);
  EXPECT_EQ(read->row(1)[1], 0);
  const Result<GrayImage> wrong = read_mask(path, 6, 5);
  ASSERT_FALSE(wrong);
  EXPECT_NE(wrong.error().message.find("6 x 4"), std::string::npos);
}

// Frames that cannot be used keep their place, wherever they are.
TEST(ImageSource, DamagedMissingEmptyAndOddImagesAreDefects) {
  const TemporaryFolder folder;
  write_images(folder.path(), 8);
  folder.file("0.png", "damaged");
  folder.file("2.png", "");
  cv::imwrite((folder.path() / "4.png").string(), pattern(30, 24, 4));
  folder.file("7.png", content_of(folder.path() / "7.png").substr(0, 60));
  std::vector<double> times;
  for (int i = 0; i < 8; ++i) times.push_back(10 + 0.5 * i);
  auto source = open_images("images", *list_images(folder.path()), times);
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->width(), 32) << "of the first good one";
  std::filesystem::remove(folder.path() / "5.png");  // after it was listed
  for (int i = 0; i < 8; ++i) {
    const Result<std::optional<InputFrame>> next = (*source)->next();
    ASSERT_TRUE(next && *next) << i;
    const InputFrame& frame = **next;
    EXPECT_EQ(frame.index, i);
    EXPECT_EQ(frame.timestamp, 10 + 0.5 * i);
    EXPECT_EQ(frame.name, std::to_string(i) + ".png");
    if (i == 1 || i == 3 || i == 6) {
      EXPECT_EQ(frame.defect, "");
      EXPECT_TRUE(same_pixels(frame.gray, pattern(32, 24, i))) << i;
    } else {
      EXPECT_NE(frame.defect.find(frame.name), std::string::npos) << frame.defect;
      EXPECT_EQ(frame.defect.find('\n'), std::string::npos) << frame.defect;
      EXPECT_TRUE(frame.gray.empty());
    }
  }
  EXPECT_FALSE(*(*source)->next());
}

TEST(ListImages, NaturalOrderByContentOrName) {
  const TemporaryFolder folder;
  write_images(folder.path(), 11);
  std::filesystem::rename(folder.path() / "10.png", folder.path() / "10.dat");
  folder.file("notes.txt", "no frame");
  folder.file(".hidden.png", "no frame");
  folder.file("mask.png", "no frame");
  folder.file("12.png", "damaged, but a frame");
  const auto files = list_images(folder.path());
  ASSERT_TRUE(files);
  ASSERT_EQ(files->size(), 12u);
  EXPECT_EQ((*files)[2].filename(), "2.png");
  EXPECT_EQ((*files)[10].filename(), "10.dat");
  EXPECT_EQ((*files)[11].filename(), "12.png");
  EXPECT_FALSE(list_images(folder.path() / "missing"));
}

TEST(MatchImages, StarsQuestionMarksAndNumbers) {
  const TemporaryFolder folder;
  for (const char* name : {"a1.png", "a02.png", "a003.png", "a10.png", "b1.png", "a.png", "ax.png"})
    folder.file(name, "");
  const auto names = [&](const std::string& pattern) {
    std::string joined;
    const auto files = match_images(folder.path() / pattern);
    if (!files) return std::string("none");
    for (const auto& file : *files) joined += file.stem().string() + " ";
    return joined;
  };
  EXPECT_EQ(names("a*.png"), "a a1 a02 a003 a10 ax ");
  EXPECT_EQ(names("a?.png"), "a1 ax ");
  EXPECT_EQ(names("*1*"), "a1 a10 b1 ");
  EXPECT_EQ(names("a%d.png"), "a1 a02 a003 a10 ");
  EXPECT_EQ(names("a%02d.png"), "a02 a003 a10 ");
  EXPECT_EQ(names("%d.png"), "none");
  EXPECT_EQ(names("c*"), "none");
}

TEST(ImageSource, APartHasTheImagesOfItsTimes) {
  const TemporaryFolder folder;
  std::vector<std::filesystem::path> files;
  for (int i = 0; i < 10; ++i) {
    files.push_back(folder.path() / std::to_string(i).append(".png"));
    cv::imwrite(files[i].string(), cv::Mat(17, 33, CV_8U, cv::Scalar(20 * i)));
  }
  const auto open = [&] { return *open_images("images", files, index_timestamps(10, 2)); };
  const std::unique_ptr<FrameSource> source = open();
  EXPECT_EQ(source->span().from, 0);
  EXPECT_EQ(source->span().to, 4.5);
  ASSERT_TRUE(source->cut({1, 2.5}));
  EXPECT_EQ(source->frame_count(), 4);
  for (int i = 0; i < 4; ++i) {
    const std::optional<InputFrame> frame = *source->next();
    EXPECT_EQ(frame->index, i);
    EXPECT_EQ(frame->timestamp, 1 + 0.5 * i);
    EXPECT_EQ(frame->gray.row(0)[0], 20 * (i + 2));
  }
  EXPECT_FALSE(source->next()->has_value());
  EXPECT_EQ(open()->cut({7, 0}).error().message, "images: no frame from 7 seconds on");
  EXPECT_EQ(open()->cut({1.1, 1.2}).error().message, "images: no frame from 1.1 to 1.2 seconds");
}

}  // namespace
}  // namespace raysfm
