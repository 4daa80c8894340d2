#include <gtest/gtest.h>

#include <ctime>
#include <string>

#include "raysfm/core/memory.h"
#include "raysfm/files/config_tree.h"
#include "raysfm/files/flow_scan.h"

namespace raysfm {
namespace {

std::string times(int count, const std::string& text) {
  std::string all;
  for (int i = 0; i < count; ++i) all += text;
  return all;
}

std::string refusal(const std::string& text) {
  const Result<ConfigNode> tree = parse_yaml(text, "file");
  return tree ? "accepted" : tree.error().message;
}

TEST(ParseYaml, KnowsTheLines) {
  const Result<ConfigNode> tree = parse_yaml("a: 1\n# nothing\nb:\n  - 2\n  - {c: 3}\n", "file");
  ASSERT_TRUE(tree) << tree.error().message;
  EXPECT_EQ(tree->find("a")->line, 1);
  EXPECT_EQ(tree->find("b")->items[0].line, 4);
  EXPECT_EQ(tree->find("b")->items[1].find("c")->line, 5);
}

TEST(ParseYaml, AKeyThatComesTwiceIsFoundWhereItComesAgain) {
  EXPECT_EQ(refusal("a: 1\nb: 2\na: 3\n"), "file: line 3: key 'a' appears twice in one map, once is allowed");
}

TEST(ParseYaml, AsDeepAsIsAllowed) {
  EXPECT_EQ(refusal(times(kMaxConfigDepth, "[") + times(kMaxConfigDepth, "]")), "accepted");
  const std::string deep = "file: line 1: nested deeper than the 32 levels that are allowed";
  EXPECT_EQ(refusal(times(kMaxConfigDepth + 1, "[") + times(kMaxConfigDepth + 1, "]")), deep);
  EXPECT_EQ(refusal(times(kMaxConfigDepth + 1, "- ") + "1"), deep);
}

// Each was read for seconds, and into gigabytes, before it was refused.
TEST(ParseYaml, MillionsOfBracketsCostNothing) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer takes time and memory of its own";
#endif
  constexpr int kMany = 2000000;
  const double peak = peak_rss_mib();
  for (const std::string& text :
       {times(kMany, "["), times(kMany, "{\"a\":"), "a: " + times(kMany, "[\"]\","), times(kMany, "[ # ]\n"),
        times(kMany, "[&a "), "[" + times(kMany, "1,") + "]"}) {
    const std::clock_t start = std::clock();
    EXPECT_NE(refusal(text), "accepted") << text.substr(0, 20);
    EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, 0.5) << text.substr(0, 20);
  }
  EXPECT_LT(peak_rss_mib() - peak, 100);
}

TEST(FlowScan, BracketsThatNestNothing) {
  const std::string many = times(100, "[");
  for (const std::string& text :
       {"a: 1 # " + many, "# " + many + "\na: 1", "a: \"" + many + "\"", "a: '" + many + "'",
        "a: 'it''s " + many + "'", "a: \"\\\"" + many + "\"", "a: x" + many, "- don't " + many,
        "a: [\"" + many + "\", '" + many + "']", "{\"a\":\"" + many + "\"}", times(100, "[]\n"),
        "[" + times(100, "[1, 2],") + "]"}) {
    EXPECT_EQ(flow_excess(text), "") << text;
  }
}

TEST(FlowScan, BracketsThatNest) {
  const std::string many = times(100, "[");
  for (const std::string& text :
       {many, "a: " + many, "- " + many, "? " + many, "\n" + many, "a: !t &b " + many, "\"a\": " + many,
        "[\"]\", " + many, "['it''s', " + many, "[\"\\\"\", " + many, "{\"a\":" + many,
        "[a # ]\n, " + many}) {
    EXPECT_NE(flow_excess(text), "") << text;
  }
  EXPECT_EQ(flow_excess("a: \"\n\n\"\nb: " + many),
            "line 4: nested deeper than the 32 levels that are allowed");
}

}  // namespace
}  // namespace raysfm
