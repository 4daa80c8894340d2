#include "raysfm/settings/config.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "raysfm/api/track.h"
#include "raysfm/core/random.h"
#include "support/damage.h"

namespace raysfm {
namespace {

class ConfigTest : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    std::ofstream(path_) << text;
    return path_;
  }
  ~ConfigTest() override { std::filesystem::remove(path_); }

  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() / ("raysfm_config_" + std::to_string(::getpid()) + ".yaml");
  TrackSettings settings_;
};

TEST_F(ConfigTest, EffectiveConfigurationReadsBackToTheSameSettings) {
  settings_.inputs = {"my \"odd\" video.mp4"};
  settings_.camera = "a: b.yaml";
  settings_.fps = 7.5;
  settings_.mono = true;
  settings_.odometry.seed = 18446744073709551615ULL;
  settings_.odometry.window = 12;
  settings_.final = "global";
  const std::string text = effective_config(settings_, "1.2.3");

  TrackSettings read;
  read.inputs = settings_.inputs;
  ASSERT_TRUE(read_config(write(text), setting_fields(read), {}).ok());
  EXPECT_EQ(effective_config(read, "1.2.3"), text);
  EXPECT_EQ(read.camera, "a: b.yaml");
  EXPECT_EQ(read.fps, 7.5);
  EXPECT_TRUE(read.mono);
  EXPECT_EQ(read.odometry.window, 12);
}

TEST_F(ConfigTest, FlagsWinOverTheFile) {
  settings_.odometry.window = 7;
  ASSERT_TRUE(read_config(write("window: 12\nfeatures: 900\n"), setting_fields(settings_), {"window"}).ok());
  EXPECT_EQ(settings_.odometry.window, 7);
  EXPECT_EQ(settings_.odometry.features, 900);
}

TEST_F(ConfigTest, BadFilesNameFileKeyAndWhatIsAllowed) {
  const auto message = [&](const std::string& text) {
    const auto result = read_config(write(text), setting_fields(settings_), {});
    EXPECT_FALSE(result.ok()) << text;
    if (result.ok()) return std::string();
    EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(result.error().message.find(path_.string()), std::string::npos);
    return result.error().message;
  };
  EXPECT_NE(message("windw: 3\n").find("'windw' is no setting"), std::string::npos);
  EXPECT_NE(message("window: many\n").find("whole number"), std::string::npos);
  EXPECT_NE(message("window: [1, 2]\n").find("whole number"), std::string::npos);
  EXPECT_NE(message("final: perhaps\n").find("none, global, hierarchical"), std::string::npos);
  message("- a\n- b\n");
  message("window: [1, 2\n");
  message(std::string(2 << 20, ' '));
}

TEST_F(ConfigTest, AFileThatSaysNothingIsNoError) {
  for (const char* text : {"", "# nothing\n", "---\n", "~\n"}) {
    EXPECT_TRUE(read_config(write(text), setting_fields(settings_), {}).ok()) << text;
  }
}

// Values are checked once the whole is known, by those who do not know where they came from.
TEST_F(ConfigTest, ErrorsOfValuesNameTheFileAndTheLine) {
  const auto record =
      read_config(write("fps: 10\nfeatures: 900\nwindow: 7\n"), setting_fields(settings_), {"window"});
  ASSERT_TRUE(record.ok());
  const auto message = [&](const std::string& text) {
    return where_it_was_set(bad_input(text), *record).message;
  };
  EXPECT_EQ(message("--features = 900: must be less"),
            path_.string() + ": line 2: features = 900: must be less");
  EXPECT_EQ(message("fps: 10; allowed: more"), path_.string() + ": line 1: fps: 10; allowed: more");
  for (const char* other :
       {"--window = 7: must be more", "video.mp4: fps unknown", "features", "--fps", ""}) {
    EXPECT_EQ(message(other), other);
  }
}

// Whatever comes in, settings or one line come out.
TEST_F(ConfigTest, DamagedFiles) {
  const std::string pieces[] = {
      ":",   "\n",          "- ",    "[",  "]",   "{",   "}",    "~",  "&a ",   "*a",
      "!t ", "|\n",         "'",     "\"", "#",   "nan", ".inf", "-1", "1e999", "99999999999999999999",
      "\t",  "%YAML:1.0\n", "---\n", "? ", "\xff"};
  const std::string whole = effective_config(settings_, "1.2.3");
  Rng random(1);
  for (int i = 0; i < 3000; ++i) {
    const std::string broken = testing_support::damaged(whole, pieces, random);
    TrackSettings settings;
    const auto record = read_config(write(broken), setting_fields(settings), {});
    if (record.ok()) continue;
    EXPECT_EQ(record.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(record.error().message.find('\n'), std::string::npos) << record.error().message;
    ASSERT_TRUE(record.error().message.starts_with(path_.string())) << record.error().message;
  }
}

TEST_F(ConfigTest, AMissingFileIsBadInput) {
  EXPECT_FALSE(read_config("no/such/file.yaml", setting_fields(settings_), {}).ok());
}

}  // namespace
}  // namespace raysfm
