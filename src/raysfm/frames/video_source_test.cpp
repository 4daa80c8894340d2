#include "raysfm/frames/video_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>

#include "raysfm/frames/image_file.h"
#include "support/encoded_images.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"
#include "support/video_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using namespace testing_support;

[[maybe_unused]] const bool silent = (silence_ffmpeg(), true);

uint8_t luma_of(int frame, int x, int y) {
  return static_cast<uint8_t>(7 * frame + 8 * x + 3 * y);
}

// Luma takes all 256 levels, chroma is that of grey.
void paint_planar(int index, AVFrame* frame) {
  for (int y = 0; y < frame->height; ++y) {
    for (int x = 0; x < frame->width; ++x) frame->data[0][y * frame->linesize[0] + x] = luma_of(index, x, y);
  }
  for (int plane = 1; plane < 3 && frame->data[plane]; ++plane) {
    for (int y = 0; y < frame->height / 2; ++y)
      std::memset(frame->data[plane] + y * frame->linesize[plane], 128, frame->width / 2);
  }
}

struct Reading {
  std::vector<InputFrame> frames;
  std::string error, note;
  int count = 0;
};

Reading read_video(const fs::path& path, double fps = 0, int threads = 0, const TimeRange& range = {}) {
  Reading reading;
  Result<std::unique_ptr<FrameSource>> source = open_video(path.string(), {.fps = fps, .threads = threads});
  if (!source) {
    EXPECT_EQ(source.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(source.error().message.find('\n'), std::string::npos);
    reading.error = source.error().message;
    return reading;
  }
  if (!range.is_all()) {
    if (auto r = (*source)->cut(range); !r) {
      reading.error = r.error().message;
      return reading;
    }
  }
  reading.count = (*source)->frame_count();
  for (;;) {
    Result<std::optional<InputFrame>> frame = (*source)->next();
    if (!frame) reading.error = frame.error().message;
    if (!frame || !*frame) break;
    reading.frames.push_back(std::move(**frame));
  }
  reading.note = (*source)->note();
  return reading;
}

TEST(VideoSource, SaysHowWideItsPixelsAre) {
  const TemporaryFolder folder;
  const auto aspect_of = [&](AVRational told) {
    const fs::path path = folder.path() / "pixels.mkv";
    write_video(path, {.pixel_aspect = told, .paint = paint_planar});
    const auto source = open_video(path.string(), {});
    return source ? (*source)->pixel_aspect() : NAN;
  };
  EXPECT_EQ(aspect_of({0, 1}), 1);
  EXPECT_NEAR(aspect_of({4, 3}), 4 / 3.0, 1e-3);
  EXPECT_NEAR(aspect_of({10, 11}), 10 / 11.0, 1e-3);
  EXPECT_EQ(aspect_of({100, 1}), 1);  // that means nothing
}

TEST(VideoSource, LimitedRangeIsStretched) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  for (int i = 0; i < 5; ++i) {
    const InputFrame& frame = video.frames[i];
    EXPECT_EQ(frame.index, i);
    EXPECT_NEAR(frame.timestamp, 0.04 * i, 1e-12);
    for (int y = 0; y < 24; ++y) {
      for (int x = 0; x < 32; ++x) {
        const double expected = std::clamp((luma_of(i, x, y) - 16) * 255.0 / 219, 0.0, 255.0);
        ASSERT_NEAR(frame.gray.row(y)[x], expected, 0.5 + 1e-9) << i << " " << x << " " << y;
        // Chroma of grey: all three colours are the grey value, but for rounding in the conversion.
        for (const int level : frame.colors.at(x, y, frame.gray.row(y)[x])) ASSERT_NEAR(level, expected, 3);
      }
    }
  }
  EXPECT_EQ(video.frames[3].name, "frame-000003");
  EXPECT_EQ(video.note, "");
}

TEST(VideoSource, FullRangeIsTakenAsItIs) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  recipe.range = AVCOL_RANGE_JPEG;
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  for (int y = 0; y < 24; ++y) {
    for (int x = 0; x < 32; ++x) ASSERT_EQ(video.frames[2].gray.row(y)[x], luma_of(2, x, y));
  }
}

TEST(VideoSource, GreyVideosHaveNoColour) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  recipe.pixels = AV_PIX_FMT_GRAY8;
  recipe.range = AVCOL_RANGE_UNSPECIFIED;
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  EXPECT_TRUE(video.frames[0].colors.empty());
  EXPECT_EQ(video.frames[1].gray.row(5)[7], luma_of(1, 7, 5));
}

TEST(VideoSource, TenBitsAreScaledToEight) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.pixels = AV_PIX_FMT_YUV420P10LE;
  recipe.paint = [](int, AVFrame* frame) {
    for (int plane = 0; plane < 3; ++plane) {
      for (int y = 0; y < (plane ? 12 : 24); ++y) {
        auto* row = reinterpret_cast<uint16_t*>(frame->data[plane] + y * frame->linesize[plane]);
        for (int x = 0; x < (plane ? 16 : 32); ++x) row[x] = static_cast<uint16_t>(plane ? 512 : 64 + 28 * x);
      }
    }
  };
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  for (int x = 0; x < 32; ++x)
    EXPECT_NEAR(video.frames[0].gray.row(3)[x], 28.0 * x * 255 / (219 * 4), 0.5 + 1e-9);
}

TEST(VideoSource, GreyOfRgbIsTheWeightedSum) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.pixels = AV_PIX_FMT_BGR0;
  recipe.range = AVCOL_RANGE_UNSPECIFIED;
  recipe.paint = [](int, AVFrame* frame) {
    for (int y = 0; y < 24; ++y) {
      for (int x = 0; x < 32; ++x) {
        uint8_t* p = frame->data[0] + y * frame->linesize[0] + 4 * x;
        p[0] = static_cast<uint8_t>(8 * x), p[1] = static_cast<uint8_t>(10 * y), p[2] = 77, p[3] = 0;
      }
    }
  };
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  EXPECT_EQ(video.frames[0].colors.at(30, 20, 0), (std::array<uint8_t, 3>{77, 200, 240}));
  EXPECT_NEAR(video.frames[0].gray.row(20)[30], 0.114 * 240 + 0.587 * 200 + 0.299 * 77, 1);
}

TEST(VideoSource, TimesComeFromTheContainerUnlessFpsIsGiven) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  recipe.milliseconds = [](int i) { return 100 + 10 * i * i; };
  write_video(folder.path() / "v.mkv", recipe);
  const Reading video = read_video(folder.path() / "v.mkv");
  ASSERT_EQ(video.frames.size(), 5u) << video.error;
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(video.frames[i].timestamp, 0.1 + 0.01 * i * i, 1e-9);
  EXPECT_NEAR(read_video(folder.path() / "v.mkv", 10).frames[4].timestamp, 0.4, 1e-12);
}

TEST(VideoSource, ACutVideoGivesTheFramesThatAreThereAndSaysSo) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  recipe.frames = 60;
  write_video(folder.path() / "whole.mkv", recipe);
  const std::string bytes = content_of(folder.path() / "whole.mkv");
  const Reading whole = read_video(folder.path() / "whole.mkv");
  ASSERT_EQ(whole.frames.size(), 60u);
  EXPECT_EQ(whole.note, "");
  const Reading cut = read_video(folder.file("cut.mkv", bytes.substr(0, bytes.size() / 2)));
  EXPECT_EQ(cut.error, "");
  ASSERT_GT(cut.frames.size(), 10u);
  ASSERT_LT(cut.frames.size(), 50u);
  EXPECT_NE(cut.note.find("cut short"), std::string::npos) << cut.note;
  for (size_t i = 0; i < cut.frames.size(); ++i) {
    ASSERT_EQ(std::memcmp(cut.frames[i].gray.row(9), whole.frames[i].gray.row(9), 32), 0) << i;
  }
}

// JPEG files one behind the other are a video.
std::string jpeg_frame(int index, int width) {
  return jpeg_file(
      {.width = width,
       .height = 48,
       .given = JCS_GRAYSCALE,
       .stored = JCS_GRAYSCALE,
       .values = std::vector<uint8_t>(static_cast<size_t>(width) * 48, static_cast<uint8_t>(20 * index))});
}

TEST(VideoSource, FramesOfAnotherSizeAreDefects) {
  const TemporaryFolder folder;
  std::string bytes;
  for (int i = 0; i < 8; ++i) bytes += jpeg_frame(i, i == 3 || i == 4 ? 80 : 64);
  const Reading video = read_video(folder.file("v.mjpeg", bytes));
  EXPECT_EQ(video.error, "");
  ASSERT_EQ(video.frames.size(), 8u);
  for (int i = 0; i < 8; ++i) {
    const InputFrame& frame = video.frames[i];
    EXPECT_EQ(frame.index, i);
    EXPECT_NEAR(frame.timestamp, i / 25.0, 1e-9);
    if (i == 3 || i == 4) {
      EXPECT_NE(frame.defect.find("80 x 48 pixels; allowed: the 64 x 48"), std::string::npos) << frame.defect;
    } else {
      EXPECT_EQ(frame.defect, "");
      EXPECT_NEAR(frame.gray.row(20)[30], 20 * i, 2);
    }
  }
}

// What the decoder does not give back has its place all the same.
TEST(VideoSource, FramesThatDoNotDecodeAreDefectsInTheirPlaces) {
  const TemporaryFolder folder;
  for (const int threads : {1, 4}) {
    std::string bytes;
    for (int i = 0; i < 9; ++i) {
      std::string frame = jpeg_frame(i, 64);
      // Tables and sizes are gone.
      if (i == 2 || i == 5 || i == 6) std::fill(frame.begin() + 20, frame.end() - 2, '\0');
      bytes += frame;
    }
    const Reading video = read_video(folder.file("v.mjpeg", bytes), 0, threads);
    EXPECT_EQ(video.error, "");
    ASSERT_EQ(video.frames.size(), 9u) << threads << " " << video.note;
    for (int i = 0; i < 9; ++i) {
      const InputFrame& frame = video.frames[i];
      EXPECT_EQ(frame.index, i);
      EXPECT_NEAR(frame.timestamp, i / 25.0, 1e-9);
      const bool damaged = i == 2 || i == 5 || i == 6;
      EXPECT_EQ(frame.defect.empty(), !damaged) << i << " " << frame.defect;
      if (damaged) continue;
      EXPECT_NEAR(frame.gray.row(20)[30], 20 * i, 2);
    }
  }
}

TEST(VideoSource, DamageNeverCrashes) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  recipe.codec = AV_CODEC_ID_MPEG4;
  recipe.frames = 30;
  write_video(folder.path() / "whole.mp4", recipe);
  const std::string bytes = content_of(folder.path() / "whole.mp4");
  for (int trial = 0; trial < 60; ++trial) {
    std::string damaged = bytes;
    for (int i = 0; i < 20; ++i) {
      damaged[(trial * 7919u + i * 104729u) % damaged.size()] = static_cast<char>(trial * 31 + i * 17);
    }
    if (trial % 3 == 0) damaged.resize(damaged.size() * (trial + 1) / 61);
    const Reading video = read_video(folder.file("damaged.mp4", damaged));
    for (size_t i = 1; i < video.frames.size(); ++i) {
      ASSERT_GT(video.frames[i].timestamp, video.frames[i - 1].timestamp);
    }
  }
}

TEST(VideoSource, WhatIsNoVideoIsRefused) {
  const TemporaryFolder folder;
  EXPECT_NE(read_video(folder.file("a.mp4", "")).error, "");
  EXPECT_NE(read_video(folder.file("a.txt", "some text\nthat is no video\n")).error, "");
  EXPECT_NE(read_video(folder.path() / "missing.mp4").error, "");
  EXPECT_NE(read_video(folder.path()).error, "");
  // A playlist would fetch other files.
  EXPECT_NE(read_video(folder.file("list.m3u8", "#EXTM3U\n#EXTINF:1,\nhttp://localhost/a.ts\n")).error, "");
}

// One thread opens, another reads, a third closes.
TEST(VideoSource, MayBeHandedFromThreadToThread) {
  const TemporaryFolder folder;
  VideoRecipe recipe;
  recipe.paint = paint_planar;
  write_video(folder.path() / "v.mkv", recipe);
  Result<std::unique_ptr<FrameSource>> source = open_video((folder.path() / "v.mkv").string(), {});
  ASSERT_TRUE(source);
  int frames = 0;
  std::thread([&] {
    for (auto frame = (*source)->next(); frame && *frame; frame = (*source)->next()) ++frames;
  }).join();
  EXPECT_EQ(frames, 5);
  std::thread([&] { source->reset(); }).join();
}

// The video was encoded from the images of the same folder.
TEST(VideoSource, RealVideoShowsTheImagesItWasMadeFrom) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("redkitchen-handheld/first200.mp4");
  const Reading video = read_video(shared_data("redkitchen-handheld/first200.mp4"));
  ASSERT_EQ(video.frames.size(), 200u) << video.error;
  EXPECT_EQ(video.count, 200);
  EXPECT_EQ(video.note, "");
  EXPECT_NEAR(video.frames[199].timestamp, 199 / 30.0, 1e-4);
  for (const int i : {0, 57, 199}) {
    char name[16];
    std::snprintf(name, sizeof(name), "%06d.jpg", i);
    const Result<DecodedImage> image = read_image(shared_data("redkitchen-handheld/images") / name);
    ASSERT_TRUE(image);
    double gray = 0, colour = 0;
    for (int y = 0; y < 480; ++y) {
      for (int x = 0; x < 640; ++x) {
        const uint8_t a = image->gray.row(y)[x], b = video.frames[i].gray.row(y)[x];
        gray += std::abs(a - b);
        const auto rgb_a = image->colors.at(x, y, a), rgb_b = video.frames[i].colors.at(x, y, b);
        for (int c = 0; c < 3; ++c) colour += std::abs(rgb_a[c] - rgb_b[c]);
      }
    }
    EXPECT_LT(gray / (640 * 480), 3) << i;
    EXPECT_LT(colour / (1920 * 480), 5) << i;
  }
}

// With key frames far apart (MPEG-4) and everywhere (FFV1), with and without an index, by times of the
// container and by a told rate: what comes is what comes of the whole video at those times.
TEST(VideoSource, APartIsWhatTheWholeHasThere) {
  const TemporaryFolder folder;
  for (const auto& [name, codec] :
       {std::pair("a.mkv", AV_CODEC_ID_FFV1), std::pair("b.mp4", AV_CODEC_ID_MPEG4),
        std::pair("c.ts", AV_CODEC_ID_MPEG4)}) {
    VideoRecipe recipe;
    recipe.paint = paint_planar;
    recipe.codec = codec;
    recipe.frames = 125;
    const std::string path = (folder.path() / name).string();
    write_video(path, recipe);
    for (const double fps : {0.0, 50.0}) {
      const Reading whole = read_video(path, fps);
      ASSERT_EQ(whole.frames.size(), 125u);
      const double first = whole.frames[0].timestamp, step = whole.frames[1].timestamp - first;
      for (const TimeRange range :
           {TimeRange{first + 80.5 * step, first + 99.5 * step},
            TimeRange{first + 2.5 * step, first + 4.5 * step}, TimeRange{first + 110.5 * step, 0}}) {
        const Reading part = read_video(path, fps, 0, range);
        ASSERT_FALSE(part.frames.empty()) << name << fps << part.error;
        EXPECT_EQ(part.note, "");
        EXPECT_EQ(part.count, -1);
        size_t k = 0;
        for (const InputFrame& frame : whole.frames) {
          if (range.is_before(frame.timestamp) || range.is_behind(frame.timestamp)) continue;
          ASSERT_LT(k, part.frames.size());
          const InputFrame& same = part.frames[k];
          EXPECT_EQ(same.index, static_cast<int>(k++));
          EXPECT_EQ(same.timestamp, frame.timestamp) << name;
          for (int y = 0; y < 24; ++y) EXPECT_EQ(std::memcmp(same.gray.row(y), frame.gray.row(y), 32), 0);
        }
        EXPECT_EQ(k, part.frames.size()) << name << fps;
      }
      const TimeRange span = (*open_video(path, {.fps = fps}))->span();
      EXPECT_EQ(span.from, first);
      const bool is_counted =
          fps == 0 || name == std::string("b.mp4");  // other containers do not count frames
      EXPECT_NEAR(span.to, is_counted ? whole.frames.back().timestamp : 0, 2 * step) << name << fps;
      EXPECT_NE(read_video(path, fps, 0, {900, 0}).error.find("no frame from 900 seconds on"),
                std::string::npos);
    }
  }
}

}  // namespace
}  // namespace raysfm
