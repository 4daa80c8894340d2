#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "raysfm/core/result.h"

namespace raysfm {

// The CRC-32 of the values of a row in their order, which every row ends with: 8 bytes of a number, the bytes
// of texts and arrays.
class RowSum {
 public:
  void add(int64_t value) { add_bytes(&value, sizeof value); }
  void add(double value) { add_bytes(&value, sizeof value); }
  void add(std::string_view bytes) { add_bytes(bytes.data(), bytes.size()); }
  int64_t value() const { return sum_; }

 private:
  void add_bytes(const void* bytes, size_t size);
  uint32_t sum_ = 0;
};

// A statement on rows of a table.
using StatementHandle = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

// Appends rows to a table: the values of a row in the order of its columns, then end_row(). What fails, fails
// in end_row().
class RowWriter {
 public:
  // `columns` of the table, its sum among them.
  RowWriter(sqlite3* database, const std::string& table, int columns);

  void integer(int64_t value);
  void real(double value);  // not NaN; a zero loses its sign
  void text(std::string_view value);
  // The bytes of the elements as they are in memory, little-endian. They have to live until end_row().
  template <typename Array>
  void array(const Array& values) {
    bytes({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(*values.data())});
  }
  bool end_row();

 private:
  void bytes(std::string_view value);
  void note(int code) { good_ = good_ && code == SQLITE_OK; }

  StatementHandle statement_;
  int column_ = 0;
  bool good_;
  RowSum sum_;
};

// Reads the rows of a table in the order of its key. The first value that is not allowed is the error, and
// from then on every value is empty.
class RowReader {
 public:
  // `name`: of the file, in messages; `query` selects all columns.
  RowReader(sqlite3* database, std::string name, const char* query);

  // Goes to the next row, which messages call `row`, and which there has to be; or to none.
  bool next_row(std::string row);
  bool no_more_rows();

  // The next column, called so. Integers are in [low, high], reals no NaN.
  int64_t integer(const char* column, int64_t low, int64_t high);
  double real(const char* column);
  std::string text(const char* column, size_t most_bytes);
  // Exactly `count` elements. Where there are none yet to take them, nothing is allocated before the size is
  // known to be right.
  template <typename Array>
  bool array(const char* column, size_t count, Array* values) {
    const size_t element = sizeof(*values->data());
    const std::string_view found = bytes(column);
    if (!has_size(column, found.size(), element, count)) return false;
    values->resize(count);
    copy(found, values->data());
    return true;
  }
  // As many elements as there are.
  template <typename Array>
  bool any_array(const char* column, Array* values) {
    return has_type(column, SQLITE_BLOB) && array(column, stored_bytes() / sizeof(*values->data()), values);
  }
  // Whether there are as many of something as there have to be.
  bool is_count(const char* column, int64_t found, int64_t expected);
  // The last column: the sum of those before it.
  bool end_row();

  bool good() const { return good_; }
  const Error& error() const { return error_; }

 private:
  bool has_type(const char* column, int type);
  bool has_size(const char* column, size_t bytes, size_t element, size_t count);
  size_t stored_bytes() const;
  std::string_view bytes(const char* column);
  static void copy(std::string_view bytes, void* to);
  bool fail(const char* column, const std::string& found, const std::string& allowed);
  bool fail(Error error);

  sqlite3* database_;
  std::string name_, row_;
  StatementHandle statement_;
  int column_ = 0;
  bool good_ = true;
  Error error_;
  RowSum sum_;
};

}  // namespace raysfm
