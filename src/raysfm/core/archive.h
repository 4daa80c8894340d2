#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace raysfm {

// The state of objects as bytes, in the order of the machine. One description of a type serves writing and
// reading:
//
//   template <typename A> void archive_fields(A& a, Thing& x) { archive(a, x.number, x.list); }
//
// or a member archive(A&) where fields are private. What is read is only as good as whoever wrote it: sizes
// are checked against the bytes that are there, what the numbers say is not.
class ArchiveWriter {
 public:
  static constexpr bool kReads = false;

  void bytes(void* data, size_t size) { content_.append(static_cast<const char*>(data), size); }
  bool good() const { return true; }
  // How many elements of at least so many bytes follow.
  void count(size_t* elements, size_t /*least_bytes*/) { bytes(elements, sizeof *elements); }

  const std::string& content() const { return content_; }

 private:
  std::string content_;
};

// Reads what an ArchiveWriter wrote. After the first thing that is not there everything read is empty.
class ArchiveReader {
 public:
  static constexpr bool kReads = true;

  explicit ArchiveReader(std::string_view content) : left_(content) {}

  void bytes(void* data, size_t size) {
    if (size == 0) return;  // there may be no data then
    good_ = good_ && size <= left_.size();
    if (!good_) {
      std::memset(data, 0, size);
      return;
    }
    std::memcpy(data, left_.data(), size);
    left_.remove_prefix(size);
  }
  void count(size_t* elements, size_t least_bytes) {
    bytes(elements, sizeof *elements);
    good_ = good_ && *elements <= left_.size() / std::max<size_t>(1, least_bytes);
    if (!good_) *elements = 0;
  }

  bool good() const { return good_; }
  // What was read cannot be.
  void refuse() { good_ = false; }
  // All of it was read.
  bool at_end() const { return good_ && left_.empty(); }

 private:
  std::string_view left_;
  bool good_ = true;
};

// Matrices and vectors of Eigen whose size is part of their type, and quaternions.
template <typename T>
concept FixedMatrix = requires(T x) {
  x.data();
  requires T::SizeAtCompileTime >
  0;
};
template <typename T>
concept DynamicMatrix = requires(T x) {
  x.data();
  requires T::SizeAtCompileTime < 0;
};
// Of a vector one of the two is part of the type.
template <DynamicMatrix T>
constexpr bool may_have_size(size_t rows, size_t columns) {
  const auto may_be = [](int fixed, size_t n) { return fixed < 0 || n == static_cast<size_t>(fixed); };
  return may_be(T::RowsAtCompileTime, rows) && may_be(T::ColsAtCompileTime, columns);
}
template <typename T>
concept QuaternionLike = requires(T x) {
  x.coeffs().data();
};

// What can be copied byte by byte, in arrays too.
template <typename T>
constexpr bool kIsFlat = std::is_floating_point_v<T> || FixedMatrix<T> ||
                         (std::is_trivially_copyable_v<T> && std::has_unique_object_representations_v<T>);
// Writes or reads one value after another.
template <typename A, typename... T>
void archive(A& a, T&... values);

template <typename A, typename T>
void archive_value(A& a, T& x) {
  if constexpr (FixedMatrix<T>) {
    a.bytes(x.data(), sizeof(typename T::Scalar) * T::SizeAtCompileTime);
  } else if constexpr (DynamicMatrix<T>) {
    size_t rows = x.rows(), columns = x.cols();
    a.count(&rows, 1);
    a.count(&columns, std::max<size_t>(1, rows) * sizeof(typename T::Scalar));
    if constexpr (A::kReads) {
      if (!a.good() || !may_have_size<T>(rows, columns)) {
        a.refuse();
        x = T{};
        return;
      }
      x.resize(static_cast<int64_t>(rows), static_cast<int64_t>(columns));
    }
    a.bytes(x.data(), rows * columns * sizeof(typename T::Scalar));
  } else if constexpr (QuaternionLike<T>) {
    archive_value(a, x.coeffs());
  } else if constexpr (kIsFlat<T>) {
    a.bytes(&x, sizeof x);
  } else if constexpr (requires { x.archive(a); }) {
    x.archive(a);
  } else {
    archive_fields(a, x);
  }
}

template <typename A>
void archive_value(A& a, std::string& text) {
  size_t count = text.size();
  a.count(&count, 1);
  if constexpr (A::kReads) text.resize(count);
  a.bytes(text.data(), count);
}

// Of arrays whose elements are not flat. Nothing is allocated for elements that are not there.
template <typename A, typename Array>
void archive_elements(A& a, Array& values) {
  size_t count = values.size();
  a.count(&count, 1);
  if constexpr (A::kReads) values.clear();
  for (size_t i = 0; i < count && a.good(); ++i) {
    if constexpr (A::kReads) values.emplace_back();
    archive_value(a, values[i]);
  }
}

template <typename A, typename T, typename Allocator>
void archive_value(A& a, std::vector<T, Allocator>& values) {
  if constexpr (kIsFlat<T>) {
    size_t count = values.size();
    a.count(&count, sizeof(T));
    if constexpr (A::kReads) values.resize(count);
    a.bytes(values.data(), count * sizeof(T));
  } else {
    archive_elements(a, values);
  }
}

template <typename A, typename T, typename Allocator>
void archive_value(A& a, std::deque<T, Allocator>& values) {
  archive_elements(a, values);
}

template <typename A, typename T>
void archive_value(A& a, std::optional<T>& value) {
  bool is_there = value.has_value();
  archive_value(a, is_there);
  if constexpr (A::kReads) value = T{};
  if (is_there) archive_value(a, *value);
  if (!is_there) value.reset();
}

// Writes or reads one value after another.
template <typename A, typename... T>
void archive(A& a, T&... values) {
  (archive_value(a, values), ...);
}

}  // namespace raysfm
