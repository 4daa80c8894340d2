#include "raysfm/saved_map/map_rows.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <bit>
#include <cstring>
#include <utility>

#include "raysfm/saved_map/map_database.h"

namespace raysfm {

static_assert(std::endian::native == std::endian::little, "swap the bytes of arrays");

namespace {

StatementHandle prepared(sqlite3* database, const std::string& sql) {
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr);
  return {statement, &sqlite3_finalize};
}

}  // namespace

void RowSum::add_bytes(const void* bytes, size_t size) {
  if (size > 0) sum_ = libdeflate_crc32(sum_, bytes, size);  // of null it would be that of a new sum
}

RowWriter::RowWriter(sqlite3* database, const std::string& table, int columns)
    : statement_(nullptr, &sqlite3_finalize) {
  std::string values = "?";
  for (int i = 1; i < columns; ++i) values += ", ?";
  statement_ = prepared(database, fmt::format("INSERT INTO {} VALUES ({})", table, values));
  good_ = statement_ != nullptr;
}

void RowWriter::integer(int64_t value) {
  sum_.add(value);
  note(sqlite3_bind_int64(statement_.get(), ++column_, value));
}

void RowWriter::real(double value) {
  value += 0.0;  // -0, which SQLite does not keep
  sum_.add(value);
  note(sqlite3_bind_double(statement_.get(), ++column_, value));
}

void RowWriter::text(std::string_view value) {
  sum_.add(value);
  note(sqlite3_bind_text64(statement_.get(), ++column_, value.empty() ? "" : value.data(), value.size(),
                           SQLITE_STATIC, SQLITE_UTF8));
}

void RowWriter::bytes(std::string_view value) {
  sum_.add(value);
  note(sqlite3_bind_blob64(statement_.get(), ++column_, value.empty() ? "" : value.data(), value.size(),
                           SQLITE_STATIC));
}

bool RowWriter::end_row() {
  integer(std::exchange(sum_, {}).value());
  good_ =
      good_ && sqlite3_step(statement_.get()) == SQLITE_DONE && sqlite3_reset(statement_.get()) == SQLITE_OK;
  sum_ = {};
  column_ = 0;
  return good_;
}

RowReader::RowReader(sqlite3* database, std::string name, const char* query)
    : database_(database), name_(std::move(name)), statement_(prepared(database, query)) {
  if (!statement_) fail(database_error(name_, database_));
}

bool RowReader::next_row(std::string row) {
  if (!good_) return false;
  row_ = std::move(row);
  column_ = 0;
  sum_ = {};
  const int step = sqlite3_step(statement_.get());
  if (step == SQLITE_ROW) return true;
  if (step != SQLITE_DONE) return fail(database_error(name_, database_));
  return fail(bad_input(fmt::format("{}: {}: missing", name_, row_)));
}

bool RowReader::no_more_rows() {
  if (!good_) return false;
  const int step = sqlite3_step(statement_.get());
  if (step == SQLITE_DONE) return true;
  if (step != SQLITE_ROW) return fail(database_error(name_, database_));
  return fail(
      bad_input(fmt::format("{}: {}: more rows follow; allowed: as many as are announced", name_, row_)));
}

int64_t RowReader::integer(const char* column, int64_t low, int64_t high) {
  if (!has_type(column, SQLITE_INTEGER)) return low;
  const int64_t value = sqlite3_column_int64(statement_.get(), column_++);
  if (value < low || value > high) {
    fail(column, fmt::format("{}", value), fmt::format("{} to {}", low, high));
    return low;
  }
  sum_.add(value);
  return value;
}

double RowReader::real(const char* column) {
  if (!has_type(column, SQLITE_FLOAT)) return 0;
  const double value = sqlite3_column_double(statement_.get(), column_++);
  sum_.add(value);
  return value;
}

std::string RowReader::text(const char* column, size_t most_bytes) {
  if (!has_type(column, SQLITE_TEXT)) return {};
  const size_t size = stored_bytes();
  if (size > most_bytes) {
    fail(column, fmt::format("{} bytes", size), fmt::format("at most {}", most_bytes));
    return {};
  }
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column_++));
  if (!text) {
    fail(database_error(name_, database_));
    return {};
  }
  sum_.add(std::string_view(text, size));
  return {text, size};
}

std::string_view RowReader::bytes(const char* column) {
  if (!has_type(column, SQLITE_BLOB)) return {};
  const size_t size = stored_bytes();
  const auto* blob = static_cast<const char*>(sqlite3_column_blob(statement_.get(), column_++));
  if (!blob && size > 0) {
    fail(database_error(name_, database_));
    return {};
  }
  const std::string_view found(blob ? blob : "", size);
  sum_.add(found);
  return found;
}

bool RowReader::is_count(const char* column, int64_t found, int64_t expected) {
  if (!good_ || found == expected) return good_;
  return fail(column, fmt::format("{} elements", found), fmt::format("{}", expected));
}

bool RowReader::end_row() {
  const int64_t sum = sum_.value();
  const int64_t stored = integer("check_sum", 0, UINT32_MAX);
  if (good_ && stored != sum)
    fail("check_sum", fmt::format("{}", stored), fmt::format("{}, that of the row", sum));
  return good_;
}

bool RowReader::has_type(const char* column, int type) {
  if (!good_) return false;
  if (sqlite3_column_type(statement_.get(), column_) == type) return true;
  return fail(column, "another type",
              type == SQLITE_INTEGER ? "an integer"
              : type == SQLITE_FLOAT ? "a real number"
              : type == SQLITE_TEXT  ? "a text"
                                     : "a BLOB");
}

bool RowReader::has_size(const char* column, size_t bytes, size_t element, size_t count) {
  if (!good_ || (bytes % element == 0 && bytes / element == count)) return good_;
  return fail(column, fmt::format("{} bytes", bytes), fmt::format("{} of {} bytes each", count, element));
}

size_t RowReader::stored_bytes() const {
  return good_ ? static_cast<size_t>(sqlite3_column_bytes(statement_.get(), column_)) : 0;
}

void RowReader::copy(std::string_view bytes, void* to) {
  if (!bytes.empty()) std::memcpy(to, bytes.data(), bytes.size());
}

bool RowReader::fail(const char* column, const std::string& found, const std::string& allowed) {
  return fail(bad_input(fmt::format("{}: {}: {}: {}; allowed: {}", name_, row_, column, found, allowed)));
}

bool RowReader::fail(Error error) {
  if (good_) error_ = std::move(error);
  return good_ = false;
}

}  // namespace raysfm
