#include "raysfm/page/frame_pictures.h"

#include <gtest/gtest.h>

#include <fstream>

#include "raysfm/frames/jpeg_pixels.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::TemporaryFolder;

// Frame i is grey of level 5 i.
void write_frames(const std::filesystem::path& folder, int count, int width, int height) {
  for (int i = 0; i < count; ++i) {
    std::ofstream file(folder / ("frame" + std::to_string(100 + i) + ".pgm"), std::ios::binary);
    file << "P5 " << width << " " << height << " 255\n";
    file << std::string(static_cast<size_t>(width) * height, static_cast<char>(5 * i));
  }
}

int level_of(const std::string& jpeg) {
  const Result<DecodedImage> image = decode_jpeg(jpeg);
  return image ? image->gray.row(image->gray.height() / 2)[image->gray.width() / 2] : -1;
}

TEST(FramePictures, AreThoseOfTheirFramesInAnyOrder) {
  const TemporaryFolder temporary;
  write_frames(temporary.path(), 45, 700, 330);
  FramePictures pictures({temporary.path().string()}, true);
  ASSERT_TRUE(pictures.open().ok());
  EXPECT_EQ(pictures.streams(), 1);
  for (const int frame : {40, 2, 44, 0, 41}) {
    const Result<std::string> jpeg = pictures.jpeg(frame, 0);
    ASSERT_TRUE(jpeg.ok()) << jpeg.error().message;
    EXPECT_NEAR(level_of(*jpeg), 5 * frame, 2);
  }
  const Result<std::string> jpeg = pictures.jpeg(3, 0);
  EXPECT_EQ(decode_jpeg(*jpeg)->gray.width(), 350);
  EXPECT_EQ(decode_jpeg(*jpeg)->gray.height(), 165);
}

TEST(FramePictures, OthersAreRefused) {
  const TemporaryFolder temporary;
  write_frames(temporary.path(), 2, 64, 48);
  FramePictures pictures({temporary.path().string()}, true);
  ASSERT_TRUE(pictures.open().ok());
  for (const auto& [frame, stream] : {std::pair(2, 0), std::pair(-1, 0), std::pair(0, 1), std::pair(0, -1)}) {
    EXPECT_FALSE(pictures.jpeg(frame, stream).ok());
  }
  EXPECT_NEAR(level_of(*pictures.jpeg(1, 0)), 5, 2);
  EXPECT_FALSE(FramePictures({(temporary.path() / "gone").string()}, true).open().ok());
  EXPECT_FALSE(FramePictures({"/dev/video0"}, true).open().ok());
}

}  // namespace
}  // namespace raysfm
