#pragma once

#include <cstdint>
#include <string_view>

namespace raysfm {

// The words of a text between runs of white space, one after another, without copying: for parsers of files
// of many megabytes.
class WordReader {
 public:
  explicit WordReader(std::string_view text) : text_(text) {}

  // False at the end of the text.
  bool next(std::string_view* word) {
    size_t at = end_;
    while (at < text_.size() && is_space(text_[at])) ++at;
    begin_ = at;
    while (at < text_.size() && !is_space(text_[at])) ++at;
    end_ = at;
    *word = text_.substr(begin_, end_ - begin_);
    return !word->empty();
  }

  // All behind the last word.
  std::string_view rest() const { return text_.substr(end_); }

  // Line of the last word, counted from 1, or of the end of the text. Looks at everything before: meant for
  // messages.
  int64_t line() const {
    int64_t line = 1;
    for (const char c : text_.substr(0, begin_)) line += c == '\n';
    return line;
  }

 private:
  static bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

  std::string_view text_;
  size_t begin_ = 0, end_ = 0;  // of the last word
};

}  // namespace raysfm
