#pragma once

#include <cassert>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace raysfm {

// Why an operation has no value. The kind decides the exit code of the program.
enum class ErrorKind {
  kBadInput,          // a file, field or value the caller can correct; exit code 2
  kNoReconstruction,  // the data do not allow an answer; exit code 3
  kInternal,          // a fault of ours; exit code 1
};

// `message` is one line that names the file, the field, the value and what is allowed.
struct Error {
  ErrorKind kind = ErrorKind::kInternal;
  std::string message;
};

inline Error bad_input(std::string message) {
  return {ErrorKind::kBadInput, std::move(message)};
}
inline Error no_reconstruction(std::string message) {
  return {ErrorKind::kNoReconstruction, std::move(message)};
}
inline Error internal_error(std::string message) {
  return {ErrorKind::kInternal, std::move(message)};
}

// A value or the reason why there is none. Expected failures travel in it; nothing is thrown.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

  bool ok() const { return state_.index() == 0; }
  explicit operator bool() const { return ok(); }

  T& value() & { return assert(ok()), std::get<0>(state_); }
  const T& value() const& { return assert(ok()), std::get<0>(state_); }
  T&& value() && { return assert(ok()), std::get<0>(std::move(state_)); }
  const Error& error() const { return assert(!ok()), std::get<1>(state_); }

  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  std::variant<T, Error> state_;
};

// Success, or the reason why not.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}

  bool ok() const { return !error_; }
  explicit operator bool() const { return ok(); }
  const Error& error() const { return assert(!ok()), *error_; }

 private:
  std::optional<Error> error_;
};

}  // namespace raysfm
