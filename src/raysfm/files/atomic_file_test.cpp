#include "raysfm/files/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <string>
#include <thread>

#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::TemporaryFolder;

int file_count(const fs::path& folder) {
  return static_cast<int>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

// No file of this process may grow beyond `bytes` while the object lives, as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, SIG_DFL);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
};

TEST(AtomicFile, WritesAndReplaces) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "f";
  ASSERT_TRUE(write_file(path, std::string("a\0b", 3)).ok());
  EXPECT_EQ(content_of(path), std::string("a\0b", 3));
  ASSERT_TRUE(write_file(path, "").ok());
  EXPECT_EQ(content_of(path), "");
  EXPECT_EQ(file_count(folder.path()), 1);
}

TEST(AtomicFile, MissingFolderIsNamed) {
  const Result<void> written = write_file("/no/such/folder/f", "x");
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(written.error().message, "/no/such/folder/f: cannot be written: No such file or directory");
}

TEST(AtomicFile, FullDiskLeavesTheOldFileAndNothingElse) {
  const TemporaryFolder folder;
  const fs::path path = folder.file("f", "old");
  {
    const FileSizeLimit limit(1000);
    const Result<void> written = write_file(path, std::string(100000, 'x'));
    ASSERT_FALSE(written.ok());
    EXPECT_NE(written.error().message.find("f: cannot be written: File too large"), std::string::npos);
  }
  EXPECT_EQ(content_of(path), "old");
  EXPECT_EQ(file_count(folder.path()), 1);
}

TEST(AtomicFile, FolderInTheWayLeavesNothing) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "f");
  EXPECT_FALSE(write_file(folder.path() / "f", "x").ok());
  EXPECT_EQ(file_count(folder.path()), 1);
}

TEST(AtomicFile, LinksStayAndLeadToTheNewContent) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "below");
  const fs::path target = folder.file("target", "old");
  const fs::path link = folder.path() / "below" / "link", chain = folder.path() / "chain";
  fs::create_symlink("../target", link);
  fs::create_symlink("below/link", chain);
  ASSERT_TRUE(write_file(chain, "new").ok());
  EXPECT_TRUE(fs::is_symlink(chain));
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(content_of(target), "new");

  const fs::path dangling = folder.path() / "dangling";
  fs::create_symlink("made", dangling);
  ASSERT_TRUE(write_file(dangling, "made").ok());
  EXPECT_TRUE(fs::is_symlink(dangling));
  EXPECT_EQ(content_of(folder.path() / "made"), "made");

  const fs::path circle = folder.path() / "circle";
  fs::create_symlink("circle", circle);
  EXPECT_FALSE(write_file(circle, "x").ok());
}

TEST(AtomicFile, PipesAndDevicesAreWrittenTo) {
  const TemporaryFolder folder;
  const fs::path pipe = folder.path() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::string seen;
  std::thread reader([&] { seen = content_of(pipe); });
  EXPECT_TRUE(write_file(pipe, "through").ok());
  reader.join();
  EXPECT_EQ(seen, "through");
  EXPECT_TRUE(fs::is_fifo(pipe));
  EXPECT_EQ(file_count(folder.path()), 1);

  const fs::path null = folder.path() / "null";  // a link, so that a mistake costs no device
  fs::create_symlink("/dev/null", null);
  EXPECT_TRUE(write_file(null, "x").ok());
  EXPECT_TRUE(fs::is_symlink(null));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST(AtomicFile, InputsAreNotReplaced) {
  const TemporaryFolder folder;
  const std::string input = folder.file("in", "x").string();
  fs::create_symlink("in", folder.path() / "link");
  const std::string inputs[] = {input};
  EXPECT_EQ(check_not_input("--out", folder.path() / "link", inputs).error().message,
            "--out: " + (folder.path() / "link").string() + " would overwrite the input " + input);
  EXPECT_TRUE(check_not_input("--out", folder.path() / "other", inputs).ok());
}

// A file that somebody else fills takes the place of the old one only when it is filled.
TEST(AtomicFile, ReplacedByWhatSomebodyElseWrites) {
  const TemporaryFolder folder;
  const fs::path path = folder.file("f", "old");
  fs::create_symlink("f", folder.path() / "link");
  const Result<void> failed = replace_file(path, [&](const fs::path& temporary) -> Result<void> {
    EXPECT_EQ(temporary.parent_path(), folder.path());
    EXPECT_EQ(fs::file_size(temporary), 0u);
    std::ofstream(temporary) << "half";
    return bad_input("cause");
  });
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, "cause");
  EXPECT_EQ(content_of(path), "old");
  EXPECT_EQ(file_count(folder.path()), 2);
  const FileFiller fill = [](const fs::path& temporary) {
    std::ofstream(temporary) << "new";
    return Result<void>();
  };
  EXPECT_TRUE(replace_file(folder.path() / "link", fill));
  EXPECT_EQ(content_of(path), "new");
  EXPECT_EQ(file_count(folder.path()), 2);
  EXPECT_FALSE(replace_file("/dev/null", fill));
  EXPECT_FALSE(replace_file(folder.path() / "none" / "f", fill));
}

// Whoever reads while it is replaced sees one of the versions, whole.
TEST(AtomicFile, ReadersNeverSeeAPart) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "f";
  constexpr size_t kBytes = 1 << 16;
  ASSERT_TRUE(write_file(path, std::string(kBytes, '0')).ok());
  std::atomic<bool> done = false;
  std::atomic<int> torn = 0;
  std::thread reader([&] {
    while (!done) {
      const std::string seen = content_of(path);
      if (seen.size() != kBytes || seen.find_first_not_of(seen[0]) != std::string::npos) ++torn;
    }
  });
  for (int i = 1; i < 100; ++i) {
    EXPECT_TRUE(write_file(path, std::string(kBytes, static_cast<char>('0' + i % 10))).ok());
  }
  done = true;
  reader.join();
  EXPECT_EQ(torn, 0);
}

}  // namespace
}  // namespace raysfm
