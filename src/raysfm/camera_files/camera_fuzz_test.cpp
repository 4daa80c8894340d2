// Random damage to camera files of every format: whatever comes in, a rig that holds together or one line
// comes out.

#include <gtest/gtest.h>

#include <ctime>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/random.h"
#include "support/camera_texts.h"
#include "support/damage.h"

namespace raysfm {
namespace {

void expect_rig_or_line(const std::string& text) {
  const Result<Rig> rig = parse_camera_file(text, "file");
  if (!rig) {
    ASSERT_EQ(rig.error().kind, ErrorKind::kBadInput);
    ASSERT_TRUE(rig.error().message.starts_with("file: ")) << rig.error().message;
    ASSERT_EQ(rig.error().message.find('\n'), std::string::npos) << rig.error().message;
    return;
  }
  ASSERT_FALSE(rig->cameras.empty());
  for (const Camera& camera : rig->cameras) {
    ASSERT_NEAR(camera.rig_from_cam.rotation.norm(), 1, 1e-9);
    ASSERT_TRUE(camera.rig_from_cam.translation.allFinite());
    Ray ray;
    if (camera.ray({0.5 * camera.width, 0.5 * camera.height}, &ray)) {
      ASSERT_NEAR(ray.direction.norm(), 1, 1e-9);
    }
  }
  // What was read can be written and read again.
  for (const Camera& camera : rig->cameras) {
    if (camera.width == 0) return;
  }
  const Result<Rig> again = parse_camera_file(format_camera_file(*rig), "file");
  ASSERT_TRUE(again) << again.error().message;
}

// Pieces that have a meaning in some format.
const std::string kPieces[] = {
    "[",   "]",           "{",  "}",    ":",   "- ",   "&a ", "*a",   "!!",           "<",    ">",     "</",
    "<_>", "&amp;",       "\"", "'",    "|\n", "\n",   "\t",  "%",    "nan",          ".inf", "1e999", "-1",
    "0",   "99999999999", "? ", "--- ", "...", "<<: ", "#",   "\xff", "\xef\xbb\xbf", "cam0", "P0:"};

TEST(CameraFuzz, DamagedFiles) {
  Rng random(20);
  for (const std::string& text : testing_support::camera_texts()) {
    for (int i = 0; i < 1500; ++i) {
      const std::string broken = testing_support::damaged(text, kPieces, random);
      expect_rig_or_line(broken);
      ASSERT_FALSE(HasFatalFailure()) << broken;
    }
  }
}

TEST(CameraFuzz, EveryBeginning) {
  for (const std::string& text : testing_support::camera_texts()) {
    for (size_t length = 0; length < text.size(); ++length) expect_rig_or_line(text.substr(0, length));
  }
}

TEST(CameraFuzz, RandomBytes) {
  Rng random(21);
  for (int i = 0; i < 2000; ++i) {
    std::string text(random.index(400), ' ');
    for (char& c : text) c = static_cast<char>(i % 2 ? random.index(256) : 32 + random.index(95));
    expect_rig_or_line(text);
  }
}

std::string repeated(const std::string& piece, size_t count) {
  std::string text;
  for (size_t i = 0; i < count; ++i) text += piece;
  return text;
}

// Documents made to exhaust a reader are refused in a moment.
TEST(CameraFuzz, HostileDocuments) {
  std::string bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 30; ++i) {
    const std::string alias = "*a" + std::to_string(i - 1);
    bomb += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + alias + repeated(", " + alias, 8) +
            "]\n";
  }
  const std::string documents[] = {
      bomb,
      "a: &a " + std::string(200000, 'x') + "\nb: [" + repeated("*a, ", 300000) + "]\n",
      "&a [*a]",
      "a: &a {b: *a}",
      repeated("&a [", 20000),
      repeated("[", 500000),
      repeated("{a: ", 100000),
      repeated("- ", 500000),
      repeated("? ", 100000),
      repeated("a:\n ", 1000),
      "[" + repeated("1,", 3000000) + "]",
      repeated("a: 1\n", 500000),
      repeated("<a>", 1000000),
      "<opencv_storage>" + repeated("<a>1</a>", 500000) + "</opencv_storage>",
      "<" + std::string(1000000, 'a'),
      repeated("<!--", 100000),
      std::string(4000000, ' ') + "x",
      std::string(4000000, '\n'),
      std::string(4000000, '\''),
      std::string(1000000, '!'),
      "%YAML:1.0",
      "%YAML 1.2\n---\na: 1\n",
      "P0:" + repeated(" 1", 2000000),
      "1 PINHOLE 640 480" + repeated(" 1", 2000000),
  };
  for (const std::string& document : documents) {
    const std::clock_t start = std::clock();
    expect_rig_or_line(document);
    const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;  // of the processor
    EXPECT_LT(seconds, 20) << document.substr(0, 20);
  }
}

}  // namespace
}  // namespace raysfm
