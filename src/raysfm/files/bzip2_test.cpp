#include "raysfm/files/bzip2.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "raysfm/core/random.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::content_of;
using testing_support::TemporaryFolder;

constexpr uintmax_t kMuch = 1 << 30;

std::string text_of(size_t bytes) {
  Rng random(1);
  std::string text;
  while (text.size() < bytes) text += std::to_string(random.normal()) + "\n";
  text.resize(bytes);
  return text;
}

std::string bzip2_refusal(std::string_view bytes, uintmax_t max_bytes = kMuch) {
  const Result<std::string> content = decompress_bzip2(bytes, max_bytes);
  if (content) return "accepted";
  EXPECT_EQ(content.error().kind, ErrorKind::kBadInput);
  return content.error().message;
}

TEST(Bzip2, GivesBackWhatWasPacked) {
  for (const size_t bytes : {size_t{0}, size_t{1}, size_t{1000}, size_t{3} << 20}) {
    const std::string text = text_of(bytes);
    const Result<std::string> content = decompress_bzip2(compress_bzip2(text), kMuch);
    ASSERT_TRUE(content) << content.error().message;
    EXPECT_EQ(*content, text);
  }
}

TEST(Bzip2, TheProgramUnderstandsUsAndWeUnderstandIt) {
  if (std::system("bzip2 --help >/dev/null 2>&1") != 0) GTEST_SKIP() << "bzip2 is not installed";
  const TemporaryFolder folder;
  const std::string text = text_of(1 << 20);
  const auto plain = folder.file("plain", text);
  const auto ours = folder.file("ours.bz2", compress_bzip2(text));
  ASSERT_EQ(std::system(("bzip2 -k '" + plain.string() + "' && bunzip2 '" + ours.string() + "'").c_str()), 0);
  EXPECT_EQ(content_of(folder.path() / "ours"), text);
  EXPECT_EQ(*decompress_bzip2(content_of(folder.path() / "plain.bz2"), kMuch), text);
}

TEST(Bzip2, SeveralStreamsOneAfterAnother) {
  const std::string bytes = compress_bzip2("first ") + compress_bzip2("") + compress_bzip2("second");
  EXPECT_EQ(*decompress_bzip2(bytes, kMuch), "first second");
}

TEST(Bzip2, CutOffAnywhere) {
  const std::string bytes = compress_bzip2(text_of(3000));
  for (size_t length = 0; length < bytes.size(); ++length) {
    EXPECT_NE(bzip2_refusal(std::string_view(bytes).substr(0, length)), "accepted") << length;
  }
  EXPECT_EQ(bzip2_refusal(std::string_view(bytes).substr(0, 100)),
            "cut off, the end of the bzip2 data is missing");
}

TEST(Bzip2, DamagedAnywhere) {
  const std::string text = text_of(3000);
  const std::string bytes = compress_bzip2(text);
  for (size_t bit = 0; bit < 8 * bytes.size(); bit += 3) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << bit % 8));
    const Result<std::string> content = decompress_bzip2(damaged, kMuch);
    // A few bits mean nothing: the size of the blocks, the padding at the end.
    if (content) {
      EXPECT_EQ(*content, text);
    }
  }
  EXPECT_EQ(bzip2_refusal(bytes + "x"), "damaged, what follows is no bzip2 data");
  EXPECT_EQ(bzip2_refusal("no bzip2 data"), "damaged, what follows is no bzip2 data");
  EXPECT_EQ(bzip2_refusal("BZh9 and then not"), "damaged, bzip2 cannot unpack it");
}

TEST(Bzip2, UnpacksNoMoreThanAllowed) {
  const std::string bomb = compress_bzip2(std::string(size_t{64} << 20, '\0'));
  ASSERT_LT(bomb.size(), 1000u);
  EXPECT_EQ(bzip2_refusal(bomb, 1000), "unpacks to more than the 1000 bytes that are allowed");
  std::string many;
  for (int i = 0; i < 1000; ++i) many += bomb;
  EXPECT_EQ(bzip2_refusal(many, 1 << 20), "unpacks to more than the 1048576 bytes that are allowed");

  const std::string exact = compress_bzip2(text_of(1000));
  EXPECT_EQ(bzip2_refusal(exact, 999), "unpacks to more than the 999 bytes that are allowed");
  EXPECT_EQ(bzip2_refusal(exact, 1000), "accepted");
}

}  // namespace
}  // namespace raysfm
