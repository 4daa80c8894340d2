#include "raysfm/files/flow_scan.h"

#include <fmt/format.h>

#include "raysfm/files/config_tree.h"

namespace raysfm {
namespace {

bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

class FlowScanner {
 public:
  explicit FlowScanner(std::string_view text) : text_(text) {}

  std::string excess() {
    for (; at_ < text_.size() && excess_.empty(); ++at_) step(text_[at_]);
    return std::move(excess_);
  }

 private:
  void step(char c) {
    if (is_blank(c)) {
      if (c == '\n') ++line_, token_may_start_ = true;
    } else if (c == '#' && (at_ == 0 || is_blank(text_[at_ - 1]))) {
      while (at_ + 1 < text_.size() && text_[at_ + 1] != '\n') ++at_;
    } else if ((c == '"' || c == '\'') && token_may_start_) {
      skip_quoted(c);
    } else if ((c == '&' || c == '*' || c == '!') && token_may_start_) {
      skip_property();
    } else if ((c == '[' || c == '{') && (depth_ > 0 || token_may_start_)) {
      open();
    } else if (depth_ > 0 && (c == ']' || c == '}')) {
      --depth_;
      token_may_start_ = false;
    } else if (depth_ > 0 && c == ',') {
      separate();
    } else {
      token_may_start_ = starts_another(c);
    }
  }

  // Whether a token may start behind `c`: a sign of a list or a key, or the colon of a key.
  bool starts_another(char c) const {
    const bool blank_follows = at_ + 1 >= text_.size() || is_blank(text_[at_ + 1]);
    if (c == ':') return blank_follows || (depth_ > 0 && at_ > 0 && ends_json_key(text_[at_ - 1]));
    return (c == '-' || c == '?') && token_may_start_ && blank_follows;
  }

  static bool ends_json_key(char c) { return c == '"' || c == '\'' || c == ']' || c == '}'; }

  void open() {
    token_may_start_ = true;
    if (++depth_ > kMaxConfigDepth) {
      refuse(fmt::format("nested deeper than the {} levels that are allowed", kMaxConfigDepth));
    }
  }

  void separate() {
    token_may_start_ = true;
    if (++separators_ > kMaxConfigNodes) {
      refuse(fmt::format("more than the {} values that are allowed", kMaxConfigNodes));
    }
  }

  // To the quote that ends it; "" and '' inside are seen as two of them.
  void skip_quoted(char quote) {
    for (++at_; at_ < text_.size() && text_[at_] != quote; ++at_) {
      if (quote == '"' && text_[at_] == '\\') ++at_;
      if (at_ < text_.size() && text_[at_] == '\n') ++line_;
    }
    token_may_start_ = quote == '\'' && at_ + 1 < text_.size() && text_[at_ + 1] == quote;
  }

  // An anchor, an alias or a tag, to its last character; what it belongs to may follow.
  void skip_property() {
    while (at_ + 1 < text_.size() && !is_blank(text_[at_ + 1]) &&
           (depth_ == 0 || std::string_view(",[]{}").find(text_[at_ + 1]) == std::string_view::npos)) {
      ++at_;
    }
  }

  void refuse(const std::string& reason) { excess_ = fmt::format("line {}: {}", line_, reason); }

  std::string_view text_;
  size_t at_ = 0;
  int line_ = 1;
  int depth_ = 0;
  int separators_ = 0;
  bool token_may_start_ = true;
  std::string excess_;
};

}  // namespace

std::string flow_excess(std::string_view document) {
  return FlowScanner(document).excess();
}

}  // namespace raysfm
