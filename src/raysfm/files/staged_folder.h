#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Files that replace those of a folder together or not at all. They are written into path(), a hidden folder
// beside it, and commit() exchanges the two in one step: whoever looks at the folder, whatever ends the
// program, finds the old files or the new ones.
//
// Files of the folder that are neither written anew nor told to be obsolete are somebody else's and stay.
// Then, and where the file system, a mount or a program that works in the folder forbids the exchange, files
// change places one by one within a moment, the last one last, and back again where one of them fails.
class StagedFolder {
 public:
  // Creates the folder where it is missing. Errors: bad input, naming the folder and the cause.
  static Result<StagedFolder> create(const std::filesystem::path& folder);
  StagedFolder(StagedFolder&& other) noexcept;
  StagedFolder& operator=(StagedFolder&&) = delete;
  // What was not committed is gone.
  ~StagedFolder();

  const std::filesystem::path& path() const { return staged_; }

  // `obsolete`: files of the folder, relative to it, that an older result left and that go where they are not
  // written anew. `last`: the name of the file that tells that all is there.
  Result<void> commit(const std::vector<std::string>& obsolete, const std::string& last);

  // The error with the folder's name as it was given instead of the hidden one's.
  Error in_place(Error error) const;

 private:
  StagedFolder() = default;
  bool exchange(const std::vector<std::string>& owned);
  void remove_old(const std::vector<std::string>& owned);

  std::filesystem::path given_, folder_, staged_;
  int lock_ = -1;  // tells other programs that this one lives
};

// Whether a name in a list of files leads to something in the folder of the list, and not out of it.
bool stays_below(const std::filesystem::path& name);

// The files below a folder, links included and not followed, relative to it, in ascending order.
std::vector<std::string> files_below(const std::filesystem::path& folder);

}  // namespace raysfm
