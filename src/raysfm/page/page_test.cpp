#include "raysfm/page/page.h"

#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "raysfm/page/page_data.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using nlohmann::json;
using testing_support::content_of;
using testing_support::small_reconstruction;
using testing_support::small_solved_reconstruction;
using testing_support::TemporaryFolder;

const Pinhole kPinhole{500, 510, 319.5, 239.5};

// RFC 4648, back to numbers.
template <typename T>
std::vector<T> unpacked(const std::string& text) {
  std::string bytes;
  uint32_t group = 0;
  int digits = 0;
  for (const char c : text) {
    if (c == '=') break;
    const size_t digit =
        std::string("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/").find(c);
    group = group << 6 | static_cast<uint32_t>(digit);
    digits += 6;
    if (digits >= 8) bytes += static_cast<char>(group >> (digits -= 8) & 255);
  }
  std::vector<T> numbers(bytes.size() / sizeof(T));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(T));
  return numbers;
}

TEST(Page, FramesAreThoseOfTheResult) {
  const Reconstruction r = small_reconstruction({kPinhole, kPinhole});
  const json data = json::parse(page_data(r, "title"));
  EXPECT_EQ(data["total"], 12);
  EXPECT_EQ(data["posed"], 11);
  EXPECT_EQ(data["missing"], json::parse(R"([{"first": 5, "last": 5, "reason": "too few matches: 3"}])"));
  ASSERT_EQ(data["cameras"].size(), 2u);
  ASSERT_EQ(data["worlds"].size(), 1u);
  const json& frames = data["worlds"][0]["frames"];
  const auto index = unpacked<uint32_t>(frames["index"]);
  const auto time = unpacked<double>(frames["time"]);
  const auto pose = unpacked<float>(frames["pose"]), covariance = unpacked<float>(frames["covariance"]);
  ASSERT_EQ(index.size(), 11u);
  ASSERT_EQ(pose.size(), 77u);
  for (size_t i = 0; i < index.size(); ++i) {
    const PosedFrame& frame = r.frames[index[i]];
    EXPECT_EQ(time[i], frame.timestamp);
    EXPECT_EQ(pose[7 * i], static_cast<float>(frame.world_from_rig->translation.x()));
    EXPECT_EQ(pose[7 * i + 6], static_cast<float>(frame.world_from_rig->rotation.w()));
    // small_reconstruction: 10 * smaller + larger, in millionths.
    EXPECT_EQ(covariance[6 * i + 2], 2e-6f);
    EXPECT_EQ(covariance[6 * i + 4], 12e-6f);
  }
  EXPECT_EQ(index[5], 6u);
  const auto keyframes = unpacked<uint32_t>(data["worlds"][0]["keyframes"]["frame"]);
  EXPECT_EQ(keyframes, (std::vector<uint32_t>{0, 3, 5, 8}));  // frames 0, 3, 6 and 9, of which 5 is not there
  // Observations are exact.
  for (const float error : unpacked<float>(data["worlds"][0]["keyframes"]["error"])) EXPECT_LT(error, 1e-6);
}

TEST(Page, PointsAreWithinAStepOfTheirPlace) {
  Reconstruction r = small_reconstruction({kPinhole});
  r.points.push_back({{1e6, 0, 0}, {1, 2, 3}});
  const json data = json::parse(page_data(r, "title"));
  const json& points = data["worlds"][0]["points"];
  EXPECT_EQ(points["count"], 200);
  EXPECT_EQ(points["far"], 1);
  const auto xyz = unpacked<uint16_t>(points["xyz"]);
  const auto rgb = unpacked<uint8_t>(points["rgb"]);
  ASSERT_EQ(xyz.size(), 600u);
  for (size_t i = 0; i < xyz.size(); ++i) {
    const double low = points["low"][i % 3], high = points["high"][i % 3];
    EXPECT_NEAR(low + xyz[i] / 65535.0 * (high - low), r.points[i / 3].position[i % 3], (high - low) / 65535);
    EXPECT_EQ(rgb[i], r.points[i / 3].rgb[i % 3]);
  }
}

TEST(Page, ManyPointsAreThinned) {
  Reconstruction r = small_reconstruction({kPinhole});
  const std::vector<MapPoint> points = r.points;
  while (r.points.size() < 150000) r.points.insert(r.points.end(), points.begin(), points.end());
  const std::string text = page_data(r, "title");
  EXPECT_LT(text.size(), 1u << 20);
  const json data = json::parse(text);
  EXPECT_EQ(data["worlds"][0]["points"]["count"], 60000);
  EXPECT_EQ(data["worlds"][0]["points"]["all"], 150000);
}

TEST(Page, LensesAndCameras) {
  const json solved = json::parse(page_data(small_solved_reconstruction(true, {}), "title"));
  ASSERT_EQ(solved["lenses"].size(), 11u);
  EXPECT_DOUBLE_EQ(solved["lenses"][3]["focal"][0], 501);
  EXPECT_EQ(unpacked<int32_t>(solved["worlds"][0]["frames"]["lens"])[3], 3);
  // The border of a pinhole, at distance one: corners at (x - cx) / fx.
  const json tracked = json::parse(page_data(small_reconstruction({kPinhole}), "title"));
  EXPECT_NEAR(tracked["cameras"][0]["directions"][0][0].get<double>(), -319.5 / 500, 1e-6);
  EXPECT_NEAR(tracked["cameras"][0]["directions"][0][1].get<double>(), -239.5 / 510, 1e-6);
}

TEST(Page, NoNameEndsTheScript) {
  const std::string title = "</script><script>alert('\"&')</script><!-- \xc3\xa4 \xff";
  Reconstruction r = small_reconstruction({kPinhole});
  r.rig.cameras[0].name = r.frames[5].reason = title;
  const std::string data = page_data(r, title);
  EXPECT_EQ(data.find('<'), std::string::npos);
  EXPECT_EQ(json::parse(page_data(r, "</script>"))["title"], "</script>");
  if (!has_page()) GTEST_SKIP() << "this build has no page";
  const TemporaryFolder temporary;
  ASSERT_TRUE(write_page(r, title, temporary.path() / "page.html").ok());
  const std::string html = content_of(temporary.path() / "page.html");
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_NE(html.find("<title>&lt;/script&gt;&lt;script&gt;alert(&#39;&quot;&amp;&#39;)"), std::string::npos);
  EXPECT_NE(html.find(data), std::string::npos);
  EXPECT_LT(html.size(), 2u << 20);
}

TEST(Page, NothingHasAPose) {
  Reconstruction r;
  r.frames.resize(3);
  for (PosedFrame& frame : r.frames) frame.reason = "black";
  const json data = json::parse(page_data(r, "title"));
  EXPECT_TRUE(data["worlds"].empty());
  EXPECT_EQ(data["missing"].size(), 1u);
}

}  // namespace
}  // namespace raysfm
