#include "raysfm/files/file_lock.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::TemporaryFolder;

TEST(FileLock, IsOneRunsUntilItEnds) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "file";
  {
    const Result<FileLock> first = FileLock::take(path);
    ASSERT_TRUE(first);
    const Result<FileLock> second = FileLock::take(path);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().message, path.string() + ": held by another run; allowed: one at a time");
    EXPECT_TRUE(FileLock::take(folder.path() / "another"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_TRUE(FileLock::take(path));
}

TEST(FileLock, EndsWithWhoIsKilled) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "file";
  int said[2];
  ASSERT_EQ(pipe(said), 0);
  const pid_t child = fork();
  if (child == 0) {
    const Result<FileLock> lock = FileLock::take(path);
    if (write(said[1], lock ? "y" : "n", 1) == 1) pause();
    _exit(1);
  }
  char taken = 0;
  ASSERT_EQ(read(said[0], &taken, 1), 1);
  EXPECT_EQ(taken, 'y');
  EXPECT_FALSE(FileLock::take(path));
  ASSERT_EQ(kill(child, SIGKILL), 0);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  EXPECT_TRUE(std::filesystem::exists(path.string() + ".lock"));
  EXPECT_TRUE(FileLock::take(path));
  close(said[0]), close(said[1]);
}

TEST(FileLock, SaysThatTheFolderIsMissing) {
  const TemporaryFolder folder;
  const Result<FileLock> lock = FileLock::take(folder.path() / "none" / "file");
  ASSERT_FALSE(lock);
  EXPECT_EQ(lock.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(lock.error().message.find("No such file"), std::string::npos) << lock.error().message;
}

}  // namespace
}  // namespace raysfm
