#include "raysfm/files/staged_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <set>
#include <system_error>
#include <utility>

#include "raysfm/files/atomic_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMark = ".raysfm-";

Error cannot_be_replaced(const fs::path& path, int cause) {
  return bad_input(fmt::format("{}: cannot be replaced: {}", path.string(), std::strerror(cause)));
}

bool is_there(const fs::path& path) {
  std::error_code missing;
  return fs::exists(fs::symlink_status(path, missing));
}

// What a program that was killed left, once it is surely not about to be locked.
void remove_leftovers(const fs::path& parent, const std::string& prefix) {
  std::error_code failure;
  for (const fs::directory_entry& entry : fs::directory_iterator(parent, failure)) {
    if (!entry.path().filename().string().starts_with(prefix) || !entry.is_directory(failure)) continue;
    const auto age = fs::file_time_type::clock::now() - entry.last_write_time(failure);
    if (failure || age < std::chrono::minutes(1)) continue;
    const int file = ::open(entry.path().c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (file < 0) continue;
    if (::flock(file, LOCK_EX | LOCK_NB) == 0) fs::remove_all(entry.path(), failure);
    ::close(file);
  }
}

// Whether the program works in the folder or below: a shell that stands there would stand nowhere.
bool is_current(const fs::path& folder) {
  std::error_code failure;
  const fs::path current = fs::current_path(failure);
  const fs::path below = current.lexically_relative(folder);
  return failure || (!below.empty() && *below.begin() != "..");
}

// Whether a folder holds these files at most, and no folders but theirs.
bool holds_only(const fs::path& folder, const std::set<std::string>& files) {
  std::error_code failure;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder, failure)) {
    const std::string name = entry.path().lexically_relative(folder).string();
    if (entry.is_directory(failure) && !entry.is_symlink(failure)) {
      const auto first = files.lower_bound(name + "/");
      if (first == files.end() || !first->starts_with(name + "/")) return false;
    } else if (!files.contains(name)) {
      return false;
    }
  }
  return !failure;
}

// Removes the folders above a file, up to `folder`, that have become empty.
void remove_empty_folders(const fs::path& folder, const std::string& file) {
  std::error_code failure;
  for (fs::path f = fs::path(file).parent_path(); !f.empty(); f = f.parent_path()) {
    if (!fs::is_empty(folder / f, failure) || failure || !fs::remove(folder / f, failure)) return;
  }
}

// Files that change places; all change back unless the changes are kept.
class Replacement {
 public:
  Replacement(fs::path folder, fs::path staged) : folder_(std::move(folder)), staged_(std::move(staged)) {}
  ~Replacement() {
    for (auto undo = undo_.rbegin(); undo != undo_.rend(); ++undo) {
      if (undo->old.empty()) ::unlink(undo->place.c_str());
      if (!undo->old.empty()) ::rename(undo->old.c_str(), undo->place.c_str());
    }
  }
  Replacement(const Replacement&) = delete;
  Replacement& operator=(const Replacement&) = delete;

  // Zero or the cause of failure.
  int put(const std::string& name) {
    const fs::path place = folder_ / name, file = staged_ / name;
    std::error_code failure;
    fs::create_directories(place.parent_path(), failure);
    if (failure) return failure.value();
    if (fs::is_directory(place, failure)) return EISDIR;
    if (!is_there(place)) return move(file, place, {});
    if (::renameat2(AT_FDCWD, file.c_str(), AT_FDCWD, place.c_str(), RENAME_EXCHANGE) == 0) {
      undo_.push_back({place, file});
      return 0;
    }
    if (errno != EINVAL && errno != ENOSYS) return errno;
    if (const int cause = take(name)) return cause;
    return ::rename(file.c_str(), place.c_str()) == 0 ? 0 : errno;
  }

  int take(const std::string& name) {
    const fs::path place = folder_ / name;
    const fs::path old = staged_ / fmt::format(".old-{}", undo_.size());
    return is_there(place) ? move(place, old, old) : 0;
  }

  void keep() { undo_.clear(); }

 private:
  struct Undo {
    fs::path place, old;  // no old: there was nothing
  };

  int move(const fs::path& from, const fs::path& to, const fs::path& old) {
    if (::rename(from.c_str(), to.c_str()) != 0) return errno;
    undo_.push_back({old.empty() ? to : from, old});
    return 0;
  }

  const fs::path folder_, staged_;
  std::vector<Undo> undo_;
};

Result<void> replace_one_by_one(const fs::path& folder, const fs::path& staged,
                                const std::vector<std::string>& obsolete,
                                const std::vector<std::string>& files) {
  Replacement replacement(folder, staged);
  for (const std::string& name : obsolete) {
    if (const int cause = replacement.take(name)) return cannot_be_replaced(folder / name, cause);
  }
  for (const std::string& name : files) {
    if (const int cause = replacement.put(name)) return cannot_be_replaced(folder / name, cause);
  }
  replacement.keep();
  for (const std::string& name : obsolete) remove_empty_folders(folder, name);
  return {};
}

}  // namespace

bool stays_below(const fs::path& name) {
  return name.has_filename() && name.is_relative() && std::ranges::find(name, fs::path("..")) == name.end() &&
         name.native().find('\0') == std::string::npos;
}

std::vector<std::string> files_below(const fs::path& folder) {
  std::vector<std::string> files;
  std::error_code failure;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder, failure)) {
    if (entry.is_directory(failure) && !entry.is_symlink(failure)) continue;
    files.push_back(entry.path().lexically_relative(folder).string());
  }
  std::ranges::sort(files);
  return files;
}

Result<StagedFolder> StagedFolder::create(const fs::path& folder) {
  if (auto created = create_folder(folder); !created) return created.error();
  std::error_code failure;
  StagedFolder staged;
  staged.given_ = folder;
  staged.folder_ = fs::canonical(folder, failure);
  if (failure) return cannot_be_replaced(folder, failure.value());
  const fs::path beside = staged.folder_.parent_path() / ("." + staged.folder_.filename().string() + kMark);
  remove_leftovers(staged.folder_, kMark);
  remove_leftovers(beside.parent_path(), beside.filename().string());
  std::string name = (staged.folder_ / (std::string(kMark) + "XXXXXX")).string();
  if (!::mkdtemp(name.data())) {
    return bad_input(
        fmt::format("{}: files cannot be written to this folder: {}", folder.string(), std::strerror(errno)));
  }
  staged.staged_ = name;
  staged.lock_ = ::open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  ::flock(staged.lock_, LOCK_EX | LOCK_NB);
  // Not where the folder is a mount of its own, or the one above is not ours to write to.
  const std::string sibling = beside.string() + name.substr(name.size() - 6);
  if (::rename(name.c_str(), sibling.c_str()) == 0) staged.staged_ = sibling;
  return staged;
}

StagedFolder::StagedFolder(StagedFolder&& other) noexcept
    : given_(std::move(other.given_)),
      folder_(std::move(other.folder_)),
      staged_(std::exchange(other.staged_, {})),
      lock_(std::exchange(other.lock_, -1)) {}

StagedFolder::~StagedFolder() {
  std::error_code ignored;
  if (!staged_.empty()) fs::remove_all(staged_, ignored);
  if (lock_ >= 0) ::close(lock_);
}

Result<void> StagedFolder::commit(const std::vector<std::string>& obsolete, const std::string& last) {
  std::vector<std::string> files = files_below(staged_), gone, owned = files;
  const auto written = [&](const std::string& name) { return std::ranges::binary_search(files, name); };
  std::ranges::remove_copy_if(obsolete, std::back_inserter(gone), written);
  owned.insert(owned.end(), gone.begin(), gone.end());
  if (exchange(owned)) return {};
  std::stable_partition(files.begin(), files.end(), [&](const std::string& name) { return name != last; });
  return replace_one_by_one(folder_, staged_, gone, files);
}

// The hidden folder has the old files afterwards.
bool StagedFolder::exchange(const std::vector<std::string>& owned) {
  const std::set<std::string> ours(owned.begin(), owned.end());
  const bool beside = staged_.parent_path() == folder_.parent_path();
  if (!beside || is_current(folder_) || !holds_only(folder_, ours)) return false;
  std::error_code failure;
  fs::permissions(staged_, fs::status(folder_, failure).permissions(), failure);
  if (::renameat2(AT_FDCWD, staged_.c_str(), AT_FDCWD, folder_.c_str(), RENAME_EXCHANGE) != 0) return false;
  const int parent = ::open(folder_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (parent >= 0) ::fsync(parent), ::close(parent);
  remove_old(owned);
  staged_.clear();
  return true;
}

void StagedFolder::remove_old(const std::vector<std::string>& owned) {
  std::error_code failure;
  for (const std::string& name : owned) fs::remove(staged_ / name, failure);
  // Whatever somebody put there in the instant before.
  for (const std::string& name : files_below(staged_)) {
    fs::create_directories((folder_ / name).parent_path(), failure);
    ::renameat2(AT_FDCWD, (staged_ / name).c_str(), AT_FDCWD, (folder_ / name).c_str(), RENAME_NOREPLACE);
  }
  for (const std::string& name : owned) remove_empty_folders(staged_, name);
  fs::remove(staged_, failure);
}

Error StagedFolder::in_place(Error error) const {
  for (const fs::path& own : {staged_, folder_}) {
    const size_t at = own.empty() ? std::string::npos : error.message.find(own.string());
    if (at == std::string::npos) continue;
    error.message.replace(at, own.string().size(), given_.string());
    break;
  }
  return error;
}

}  // namespace raysfm
