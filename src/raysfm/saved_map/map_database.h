#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "raysfm/core/result.h"

namespace raysfm {

// Who the file belongs to, in its header: "RayM".
constexpr int32_t kMapApplication = 0x5261794d;

// Tracks of a row of track_block; the last row of a world may have fewer.
constexpr int kTracksInBlock = 4096;

// An open file with the tables of a map.
using DatabaseHandle = std::unique_ptr<sqlite3, decltype(&sqlite3_close)>;

// Makes the tables in an empty file that is there already, in a transaction that finish_map_database() ends.
// Nothing is safe against interruption: the file is to be moved to its place when it is done. Errors call it
// `name`.
Result<DatabaseHandle> create_map_database(const std::filesystem::path& path, const std::string& name);
Result<void> finish_map_database(DatabaseHandle database, const std::string& name);

// A file of anybody's, read only. Its header and tables are those of a map of this version.
Result<DatabaseHandle> open_map_database(const std::filesystem::path& path);

// What went wrong last in the file called `name`.
Error database_error(const std::string& name, sqlite3* database);

}  // namespace raysfm
