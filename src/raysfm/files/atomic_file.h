#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "raysfm/core/result.h"

namespace raysfm {

// Writes a whole file beside its final name, flushes it to the disk and renames it, so that whoever looks at
// `path` sees the old content or the new content and never a part. On failure (no such folder, no permission,
// disk full) nothing is left behind and an existing file stays as it was; the error names the file and the
// cause. A link stays and what it leads to is replaced; what is no regular file, such as a device or a pipe,
// is written to.
Result<void> write_file(const std::filesystem::path& path, std::string_view content);

// The same of content that need not be there as a whole: each call makes the next part, which is empty at the
// end.
using ContentParts = std::function<std::string_view()>;
Result<void> write_file(const std::filesystem::path& path, const ContentParts& next_part);

// The same of content that somebody else writes, such as a library that wants a name: `write` fills the empty
// file beside `path` that it is given. Only where `path` is, or will be, a regular file.
using FileFiller = std::function<Result<void>(const std::filesystem::path& temporary)>;
Result<void> replace_file(const std::filesystem::path& path, const FileFiller& fill);

// Creates a folder, and those above it, unless it is there. Errors: bad input, naming the folder.
Result<void> create_folder(const std::filesystem::path& folder);

// Bad input, with `flag`, where writing the file `path` would replace one of the inputs. An input that is no
// file, or not there, is in nobody's way.
Result<void> check_not_input(const std::string& flag, const std::filesystem::path& path,
                             std::span<const std::string> inputs);

}  // namespace raysfm
