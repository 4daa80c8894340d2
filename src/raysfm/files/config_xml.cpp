#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "raysfm/files/config_tree.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr std::string_view kXmlSpace = " \t\r\n";

// Reader of the small part of XML that FileStorage writes. It keeps the open elements in a list instead of
// recursing, so that nesting costs no stack.
class XmlReader {
 public:
  explicit XmlReader(std::string_view text) : text_(text) {}

  // The root element, or nullopt with error() set.
  std::optional<ConfigNode> read() {
    while (error_.empty() && position_ < text_.size()) {
      if (text_[position_] != '<') {
        read_text();
      } else if (!skip("<?", "?>") && !skip("<!--", "-->")) {
        read_tag();
      }
    }
    if (error_.empty() && (!open_.empty() || !done_)) fail("ends inside an element or without one");
    if (!error_.empty()) return std::nullopt;
    return std::move(root_);
  }

  std::string error() const { return error_; }

 private:
  struct Open {
    std::string name;
    ConfigNode node;
  };

  void fail(std::string reason) {
    const auto lines = std::count(text_.begin(), text_.begin() + std::min(position_, text_.size()), '\n');
    error_ = fmt::format("line {}: {}", lines + 1, reason);
  }

  bool skip(std::string_view begin, std::string_view end) {
    if (!text_.substr(position_).starts_with(begin)) return false;
    const size_t found = text_.find(end, position_ + begin.size());
    if (found == std::string_view::npos) {
      fail(fmt::format("'{}' without '{}'", begin, end));
    } else {
      position_ = found + end.size();
    }
    return true;
  }

  void read_text() {
    const size_t end = std::min(text_.find('<', position_), text_.size());
    const std::string_view piece = text_.substr(position_, end - position_);
    if (open_.empty()) {
      if (piece.find_first_not_of(kXmlSpace) != std::string_view::npos)
        return fail("text outside the root element");
    } else {
      append_unescaped(piece, &open_.back().node.text);
    }
    position_ = end;
  }

  void append_unescaped(std::string_view piece, std::string* out) {
    constexpr std::pair<std::string_view, char> kEntities[] = {
        {"&amp;", '&'}, {"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}};
    while (!piece.empty()) {
      const size_t plain = std::min(piece.find('&'), piece.size());
      out->append(piece.substr(0, plain));
      piece.remove_prefix(plain);
      if (piece.empty()) return;
      const auto entity = std::find_if(std::begin(kEntities), std::end(kEntities),
                                       [&](const auto& e) { return piece.starts_with(e.first); });
      if (entity == std::end(kEntities)) return fail("an entity that is not allowed");
      out->push_back(entity->second);
      piece.remove_prefix(entity->first.size());
    }
  }

  void read_tag() {
    const size_t end = text_.find('>', position_);
    if (end == std::string_view::npos) return fail("'<' without '>'");
    std::string_view tag = text_.substr(position_ + 1, end - position_ - 1);
    const bool closing = tag.starts_with('/');
    const bool empty_element = tag.ends_with('/');
    if (closing) tag.remove_prefix(1);
    const std::string name(tag.substr(0, std::min(tag.find_first_of(" \t\r\n/"), tag.size())));
    if (name.empty() || name.front() == '!') return fail("a tag that is not allowed");
    if (closing) {
      close(name);
    } else {
      open(name);
      if (empty_element && error_.empty()) close(name);
    }
    position_ = end + 1;
  }

  void open(const std::string& name) {
    if (done_) return fail("a second root element");
    if (static_cast<int>(open_.size()) >= kMaxConfigDepth) {
      return fail(fmt::format("nested deeper than the {} levels that are allowed", kMaxConfigDepth));
    }
    if (++nodes_ > kMaxConfigNodes) {
      return fail(fmt::format("more than the {} values that are allowed", kMaxConfigNodes));
    }
    open_.push_back({name, {}});
  }

  void close(const std::string& name) {
    if (open_.empty() || open_.back().name != name)
      return fail(fmt::format("'</{}>' does not match", shown(name)));
    ConfigNode node = std::move(open_.back().node);
    open_.pop_back();
    if (node.items.empty()) {
      node.kind = ConfigNode::Kind::kScalar;
      const size_t first = std::min(node.text.find_first_not_of(kXmlSpace), node.text.size());
      node.text.erase(0, first);
      node.text.erase(node.text.find_last_not_of(kXmlSpace) + 1);
    } else {
      node.text.clear();
      const auto& keys = node.keys;
      const bool list = std::all_of(keys.begin(), keys.end(), [](const auto& key) { return key == "_"; });
      node.kind = list ? ConfigNode::Kind::kList : ConfigNode::Kind::kMap;
      if (list) node.keys.clear();
    }
    if (!check_keys(node)) return;
    if (open_.empty()) {
      root_ = std::move(node);
      done_ = true;
    } else {
      open_.back().node.keys.push_back(name);
      open_.back().node.items.push_back(std::move(node));
    }
  }

  bool check_keys(const ConfigNode& node) {
    std::vector<std::string> keys = node.keys;
    std::sort(keys.begin(), keys.end());
    const auto twice = std::adjacent_find(keys.begin(), keys.end());
    if (twice == keys.end()) return true;
    fail(fmt::format("element '{}' appears twice, once is allowed", shown(*twice)));
    return false;
  }

  std::string_view text_;
  size_t position_ = 0;
  int nodes_ = 0;
  bool done_ = false;
  ConfigNode root_;
  std::vector<Open> open_;
  std::string error_;
};

}  // namespace

Result<ConfigNode> parse_xml(std::string_view text, const std::string& name) {
  XmlReader reader(text);
  std::optional<ConfigNode> root = reader.read();
  if (!root) return bad_input(fmt::format("{}: {}", name, reader.error()));
  return std::move(*root);
}

}  // namespace raysfm
