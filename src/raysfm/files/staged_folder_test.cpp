#include "raysfm/files/staged_folder.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <map>

#include "raysfm/files/atomic_file.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::TemporaryFolder;
using Contents = std::map<std::string, std::string>;

Contents contents_of(const fs::path& folder) {
  Contents contents;
  for (const std::string& name : files_below(folder)) contents[name] = content_of(folder / name);
  return contents;
}

void fill(const fs::path& folder, const Contents& contents) {
  for (const auto& [name, content] : contents) {
    fs::create_directories((folder / name).parent_path());
    std::ofstream(folder / name, std::ios::binary) << content;
  }
}

class StagedFolderTest : public ::testing::Test {
 protected:
  Result<void> replace(const Contents& contents, const std::vector<std::string>& obsolete = {}) {
    Result<StagedFolder> staged = StagedFolder::create(out_);
    if (!staged) return staged.error();
    fill(staged->path(), contents);
    Result<void> written = staged->commit(obsolete, "report");
    return written ? written : staged->in_place(written.error());
  }
  // Nothing hidden is left.
  void TearDown() override {
    for (const auto& entry : fs::recursive_directory_iterator(temporary_.path())) {
      EXPECT_EQ(entry.path().filename().string().find(".raysfm-"), std::string::npos) << entry.path();
    }
  }
  // Tells whether the folder was exchanged or its files one by one.
  ino_t inode() const {
    struct stat status {};
    EXPECT_EQ(stat(out_.c_str(), &status), 0);
    return status.st_ino;
  }

  TemporaryFolder temporary_;
  const fs::path out_ = temporary_.path() / "out";
  const Contents old_ = {{"a", "old a"}, {"sparse/b", "old b"}, {"worlds/1/a", "old"}, {"report", "old"}};
  const Contents new_ = {{"a", "new a"}, {"sparse/b", "new b"}, {"report", "new"}};
  const std::vector<std::string> obsolete_ = {"a", "sparse/b", "worlds/1/a", "report"};
};

TEST_F(StagedFolderTest, WhatIsNotCommittedIsGone) {
  fill(out_, old_);
  {
    const Result<StagedFolder> staged = StagedFolder::create(out_);
    ASSERT_TRUE(staged.ok());
    fill(staged->path(), new_);
  }
  EXPECT_EQ(contents_of(out_), old_);
}

TEST_F(StagedFolderTest, AFolderOfOurFilesIsExchanged) {
  ASSERT_TRUE(replace(old_).ok());
  EXPECT_EQ(contents_of(out_), old_);
  fs::permissions(out_, fs::perms::owner_all | fs::perms::group_read);
  const ino_t before = inode();
  ASSERT_TRUE(replace(new_, obsolete_).ok());
  EXPECT_EQ(contents_of(out_), new_);
  EXPECT_FALSE(fs::exists(out_ / "worlds"));
  EXPECT_NE(inode(), before);
  EXPECT_EQ(fs::status(out_).permissions(), fs::perms::owner_all | fs::perms::group_read);
}

TEST_F(StagedFolderTest, FilesOfOthersStay) {
  fill(out_, old_);
  const Contents others = {{"notes.txt", "mine"}, {"sparse/database.db", "mine"}, {"images/1.png", "mine"}};
  fill(out_, others);
  fs::create_directory(out_ / "empty");
  fs::create_symlink("nowhere", out_ / "link");
  const ino_t before = inode();
  ASSERT_TRUE(replace(new_, obsolete_).ok());
  EXPECT_EQ(inode(), before);
  EXPECT_TRUE(fs::is_symlink(out_ / "link"));
  fs::remove(out_ / "link");
  Contents expected = new_;
  expected.insert(others.begin(), others.end());
  EXPECT_EQ(contents_of(out_), expected);
  EXPECT_FALSE(fs::exists(out_ / "worlds"));
  EXPECT_TRUE(fs::is_directory(out_ / "empty"));
}

TEST_F(StagedFolderTest, AFileThatCannotBeReplacedLeavesTheOldOnes) {
  Contents old = old_;
  old.erase("a");
  fill(out_, old);
  fs::create_directories(out_ / "report2");
  fill(out_, {{"zoo/mine", "mine"}});
  old.insert({"zoo/mine", "mine"});
  Contents more = new_;
  more["zoo"] = "a file where somebody has a folder";
  const Result<void> replaced = replace(more, obsolete_);
  ASSERT_FALSE(replaced.ok());
  EXPECT_EQ(replaced.error().message, (out_ / "zoo").string() + ": cannot be replaced: Is a directory");
  EXPECT_EQ(contents_of(out_), old);
}

TEST_F(StagedFolderTest, AFolderThatIsWorkedInStaysTheSame) {
  fill(out_, old_);
  const fs::path before = fs::current_path();
  fs::current_path(out_);
  const ino_t folder = inode();
  EXPECT_TRUE(replace(new_, obsolete_).ok());
  fs::current_path(before);
  EXPECT_EQ(inode(), folder);
  EXPECT_EQ(contents_of(out_), new_);
}

TEST_F(StagedFolderTest, ALinkToAFolderStaysALink) {
  fill(temporary_.path() / "target", old_);
  fs::create_directory_symlink("target", out_);
  ASSERT_TRUE(replace(new_, obsolete_).ok());
  EXPECT_TRUE(fs::is_symlink(out_));
  EXPECT_EQ(contents_of(temporary_.path() / "target"), new_);
}

TEST_F(StagedFolderTest, LeftoversOfKilledProgramsGoButNotThoseOfLivingOnes) {
  fill(out_, old_);
  const fs::path dead = temporary_.path() / ".out.raysfm-abcdef";
  fill(dead, new_);
  fs::last_write_time(dead, fs::file_time_type::clock::now() - std::chrono::hours(1));
  Result<StagedFolder> living = StagedFolder::create(out_);
  ASSERT_TRUE(living.ok());
  EXPECT_FALSE(fs::exists(dead));
  fs::last_write_time(living->path(), fs::file_time_type::clock::now() - std::chrono::hours(1));
  ASSERT_TRUE(replace(new_, obsolete_).ok());
  EXPECT_TRUE(fs::exists(living->path()));
}

TEST_F(StagedFolderTest, ErrorsNameTheFolderAsItWasGiven) {
  Result<StagedFolder> staged = StagedFolder::create(out_ / "." / "");
  ASSERT_TRUE(staged.ok());
  const Result<void> written = write_file(staged->path() / "no" / "such", "");
  EXPECT_EQ(staged->in_place(written.error()).message,
            (out_ / "." / "").string() + "/no/such: cannot be written: No such file or directory");
}

}  // namespace
}  // namespace raysfm
