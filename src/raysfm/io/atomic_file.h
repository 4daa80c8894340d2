#pragma once

#include <filesystem>
#include <string_view>

#include "raysfm/core/result.h"

namespace raysfm {

// Writes a whole file beside its final name, flushes it to the disk and renames it, so that whoever looks at
// `path` sees the old content or the new content and never a part. On failure (no such folder, no permission,
// disk full) nothing is left behind and an existing file stays as it was; the error names the file and the
// cause.
Result<void> write_file(const std::filesystem::path& path, std::string_view content);

}  // namespace raysfm
