#include "raysfm/saved_map/map_database.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>

#include "raysfm/saved_map/saved_map.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTables[] = {
    "CREATE TABLE keyframe(world INTEGER NOT NULL, keyframe INTEGER NOT NULL, frame INTEGER NOT NULL, "
    "timestamp REAL NOT NULL, image TEXT NOT NULL, rig_from_world BLOB NOT NULL, features INTEGER NOT NULL, "
    "cameras BLOB NOT NULL, pixels BLOB NOT NULL, octaves BLOB NOT NULL, tracks BLOB NOT NULL, "
    "inliers BLOB NOT NULL, rays BLOB NOT NULL, described BLOB NOT NULL, descriptors BLOB NOT NULL, "
    "check_sum INTEGER NOT NULL, PRIMARY KEY(world, keyframe)) STRICT, WITHOUT ROWID",
    "CREATE TABLE map(id INTEGER PRIMARY KEY, cameras TEXT NOT NULL, rig_from_cam BLOB NOT NULL, "
    "worlds INTEGER NOT NULL, check_sum INTEGER NOT NULL) STRICT",
    "CREATE TABLE track_block(world INTEGER NOT NULL, block INTEGER NOT NULL, positions BLOB NOT NULL, "
    "flags BLOB NOT NULL, colors BLOB NOT NULL, lengths BLOB NOT NULL, observations BLOB NOT NULL, "
    "check_sum INTEGER NOT NULL, PRIMARY KEY(world, block)) STRICT, WITHOUT ROWID",
    "CREATE TABLE world(world INTEGER PRIMARY KEY, keyframes INTEGER NOT NULL, tracks INTEGER NOT NULL, "
    "scale_sigma REAL NOT NULL, guessed_keyframe INTEGER NOT NULL, guessed_distance REAL NOT NULL, "
    "rescaled REAL NOT NULL, free_tracks BLOB NOT NULL, check_sum INTEGER NOT NULL) STRICT",
};

Result<void> run(sqlite3* database, const std::string& name, const std::string& sql) {
  if (sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK) return {};
  return database_error(name, database);
}

// `name` is that of the file in messages.
Result<DatabaseHandle> open(const std::string& file, const std::string& name, int flags) {
  sqlite3* database = nullptr;
  const int failure = sqlite3_open_v2(file.c_str(), &database, flags | SQLITE_OPEN_NOMUTEX, nullptr);
  DatabaseHandle handle(database, &sqlite3_close);
  if (failure == SQLITE_OK) return handle;
  if (!database) return internal_error(fmt::format("{}: not enough memory to open it", name));
  return database_error(name, database);
}

std::string path_in_full(const fs::path& path) {
  std::error_code failure;
  const fs::path full = fs::absolute(path, failure);
  return (failure ? path : full).string();
}

// The path as a URI of a file that nobody changes: journals beside it are not looked at, nothing is locked.
std::string immutable_uri(const fs::path& path) {
  std::string uri = "file://";
  for (const char c : path_in_full(path)) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       c == '/' || c == '.' || c == '_' || c == '-';
    uri += plain ? std::string(1, c) : fmt::format("%{:02x}", static_cast<unsigned char>(c));
  }
  return uri + "?immutable=1";
}

// The first bytes of every SQLite file.
struct Header {
  std::array<unsigned char, 100> bytes = {};

  uint32_t number(int at, int size) const {
    uint32_t value = 0;
    for (int i = 0; i < size; ++i) value = value << 8 | bytes[at + i];
    return value;
  }
  uint64_t page_bytes() const { return number(16, 2) == 1 ? 65536 : number(16, 2); }
  uint64_t pages() const { return number(28, 4); }
  int version() const { return static_cast<int>(number(60, 4)); }
  bool is_of_map() const {
    constexpr std::string_view kMagic("SQLite format 3\0", 16);
    return std::equal(kMagic.begin(), kMagic.end(), bytes.begin()) && number(68, 4) == kMapApplication;
  }
};

Result<void> check_header(const fs::path& path, uintmax_t* file_bytes) {
  std::error_code failure;
  const fs::file_status status = fs::status(path, failure);
  if (!fs::exists(status)) return bad_input(fmt::format("{}: no such file", path.string()));
  if (!fs::is_regular_file(status)) return bad_input(fmt::format("{}: not a file", path.string()));
  *file_bytes = fs::file_size(path, failure);
  std::ifstream file(path, std::ios::binary);
  Header header;
  file.read(reinterpret_cast<char*>(header.bytes.data()), header.bytes.size());
  if (failure || !file.is_open()) return bad_input(fmt::format("{}: cannot be read", path.string()));
  if (!file || !header.is_of_map()) {
    return bad_input(fmt::format("{}: not a saved map; allowed: a file of track --save-map", path.string()));
  }
  if (header.version() != kSavedMapVersion) {
    return bad_input(fmt::format("{}: a saved map of version {}; allowed: version {}", path.string(),
                                 header.version(), kSavedMapVersion));
  }
  if (*file_bytes != header.pages() * header.page_bytes()) {
    return bad_input(fmt::format("{}: {} bytes, of {} that a whole one has", path.string(), *file_bytes,
                                 header.pages() * header.page_bytes()));
  }
  return {};
}

// What a stranger's file may not do: run code of its schema, or ask for more memory than it has bytes.
void restrict_to_reading(sqlite3* database, uintmax_t file_bytes) {
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  constexpr uintmax_t kMostBytes = 1'000'000'000;
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, static_cast<int>(std::min(file_bytes, kMostBytes)));
  sqlite3_limit(database, SQLITE_LIMIT_ATTACHED, 0);
}

// The tables and nothing else: no views, triggers, indices, generated columns.
Result<void> check_tables(sqlite3* database, const std::string& name) {
  sqlite3_stmt* prepared = nullptr;
  constexpr const char* kQuery = "SELECT sql FROM sqlite_schema ORDER BY name";
  if (sqlite3_prepare_v2(database, kQuery, -1, &prepared, nullptr) != SQLITE_OK) {
    return database_error(name, database);
  }
  const std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)> query(prepared, &sqlite3_finalize);
  const Error other = bad_input(fmt::format("{}: tables that are not those of a saved map", name));
  for (const std::string_view table : kTables) {
    const int step = sqlite3_step(prepared);
    if (step != SQLITE_ROW) return step == SQLITE_DONE ? other : database_error(name, database);
    const auto* sql = reinterpret_cast<const char*>(sqlite3_column_text(prepared, 0));
    if (!sql || table != std::string_view(sql, sqlite3_column_bytes(prepared, 0))) return other;
  }
  const int step = sqlite3_step(prepared);
  if (step == SQLITE_ROW) return other;
  return step == SQLITE_DONE ? Result<void>() : database_error(name, database);
}

}  // namespace

Error database_error(const std::string& name, sqlite3* database) {
  return bad_input(fmt::format("{}: {}", name, sqlite3_errmsg(database)));
}

Result<DatabaseHandle> create_map_database(const fs::path& path, const std::string& name) {
  Result<DatabaseHandle> database = open(path.string(), name, SQLITE_OPEN_READWRITE);
  if (!database) return database;
  std::string sql = fmt::format(
      "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA application_id = {}; PRAGMA user_version "
      "= {}; "
      "BEGIN;",
      kMapApplication, kSavedMapVersion);
  for (const std::string_view table : kTables) sql += fmt::format("{};", table);
  if (const Result<void> done = run(database->get(), name, sql); !done) return done.error();
  return database;
}

Result<void> finish_map_database(DatabaseHandle database, const std::string& name) {
  return run(database.get(), name, "COMMIT");
}

Result<DatabaseHandle> open_map_database(const fs::path& path) {
  const std::string name = path.string();
  uintmax_t file_bytes = 0;
  if (const Result<void> good = check_header(path, &file_bytes); !good) return good.error();
  Result<DatabaseHandle> database = open(immutable_uri(path), name, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
  if (!database) return database;
  restrict_to_reading(database->get(), file_bytes);
  const Result<void> careful =
      run(database->get(), name, "PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0");
  if (!careful) return careful.error();
  if (const Result<void> good = check_tables(database->get(), name); !good) return good.error();
  return database;
}

}  // namespace raysfm
