#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <sstream>
#include <stdexcept>

#include "raysfm/files/config_tree.h"
#include "raysfm/files/flow_scan.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

// Refusal of a document while yaml-cpp parses it. It passes yaml-cpp and is caught in parse_yaml.
struct Refused {
  std::string reason;
};

// So many characters of a scalar count as one more value.
constexpr size_t kTextPerNode = 32;

// Builds the tree from the events of the parser, so that the limits hold before anything large or deep
// exists.
class TreeBuilder : public YAML::EventHandler {
 public:
  ConfigNode take_root() { return std::move(root_); }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add_leaf(mark, anchor, {}); }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                const std::string& value) override {
    ConfigNode node;
    node.kind = ConfigNode::Kind::kScalar;
    node.text = value;
    add_leaf(mark, anchor, std::move(node));
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto target = anchors_.find(anchor);
    if (target == anchors_.end()) refuse(mark, "an alias inside its own anchor");
    count(mark, target->second.nodes);
    if (static_cast<int>(open_.size()) + target->second.depth > kMaxConfigDepth) refuse_depth(mark);
    attach(mark, ConfigNode(target->second.node));
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(mark, anchor, ConfigNode::Kind::kList);
  }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(mark, anchor, ConfigNode::Kind::kMap);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapEnd() override { close(); }

 private:
  struct Open {
    ConfigNode node;
    YAML::Mark mark;
    YAML::anchor_t anchor;
    int nodes_before;  // value of nodes_ when it was opened
    bool has_key = false;
    std::string key;
  };
  struct Anchored {
    ConfigNode node;
    int nodes;
    int depth;
  };

  [[noreturn]] static void refuse(int line, const std::string& reason) {
    throw Refused{fmt::format("line {}: {}", line, reason)};
  }
  [[noreturn]] static void refuse(const YAML::Mark& mark, const std::string& reason) {
    refuse(mark.line + 1, reason);
  }
  [[noreturn]] static void refuse_depth(const YAML::Mark& mark) {
    refuse(mark, fmt::format("nested deeper than the {} levels that are allowed", kMaxConfigDepth));
  }

  void count(const YAML::Mark& mark, int nodes) {
    nodes_ += nodes;
    if (nodes_ > kMaxConfigNodes) {
      refuse(mark, fmt::format("more than the {} values that are allowed", kMaxConfigNodes));
    }
  }

  void open(const YAML::Mark& mark, YAML::anchor_t anchor, ConfigNode::Kind kind) {
    count(mark, 1);
    if (static_cast<int>(open_.size()) >= kMaxConfigDepth) refuse_depth(mark);
    open_.push_back({{}, mark, anchor, nodes_ - 1, false, {}});
    open_.back().node.kind = kind;
  }

  void close() {
    Open done = std::move(open_.back());
    open_.pop_back();
    check_keys(done);
    remember(done.anchor, done.node, nodes_ - done.nodes_before);
    attach(done.mark, std::move(done.node));
  }

  void add_leaf(const YAML::Mark& mark, YAML::anchor_t anchor, ConfigNode node) {
    const int size = 1 + static_cast<int>(node.text.size() / kTextPerNode);
    count(mark, size);
    remember(anchor, node, size);
    attach(mark, std::move(node));
  }

  static int depth(const ConfigNode& node) {
    int deepest = 0;
    for (const ConfigNode& item : node.items) deepest = std::max(deepest, depth(item));
    return node.items.empty() ? 0 : deepest + 1;
  }

  void remember(YAML::anchor_t anchor, const ConfigNode& node, int nodes) {
    if (anchor == 0) return;
    // The copy is memory like any other, or thousands of nested anchors would hide a large document.
    count({}, nodes);
    anchors_[anchor] = {node, nodes, depth(node)};
  }

  void attach(const YAML::Mark& mark, ConfigNode node) {
    node.line = mark.line + 1;
    if (open_.empty()) {
      root_ = std::move(node);
      return;
    }
    Open& parent = open_.back();
    if (parent.node.kind == ConfigNode::Kind::kMap && !parent.has_key) {
      if (node.kind != ConfigNode::Kind::kScalar) refuse(mark, "a key that is no scalar");
      parent.key = std::move(node.text);
      parent.has_key = true;
      return;
    }
    if (parent.node.kind == ConfigNode::Kind::kMap) parent.node.keys.push_back(std::move(parent.key));
    parent.has_key = false;
    parent.node.items.push_back(std::move(node));
  }

  static void check_keys(const Open& done) {
    std::vector<std::string> keys = done.node.keys;
    std::sort(keys.begin(), keys.end());
    const auto twice = std::adjacent_find(keys.begin(), keys.end());
    if (twice == keys.end()) return;
    size_t last = done.node.keys.size() - 1;
    while (done.node.keys[last] != *twice) --last;
    refuse(done.node.items[last].line,
           fmt::format("key '{}' appears twice in one map, once is allowed", shown(*twice)));
  }

  ConfigNode root_;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, Anchored> anchors_;
  int nodes_ = 0;
};

// OpenCV's own reader takes "key:-1" for a key and a value; YAML wants a space there. Adds it where a line
// begins with a plain word and a colon.
std::string with_spaces_after_keys(const std::string& document) {
  std::string out;
  out.reserve(document.size());
  for (size_t begin = 0; begin < document.size();) {
    size_t end = document.find('\n', begin);
    end = end == std::string::npos ? document.size() : end + 1;
    size_t at = begin;
    while (at < end && (document[at] == ' ' || std::isalnum(static_cast<unsigned char>(document[at])) ||
                        document[at] == '_' || document[at] == '.')) {
      ++at;
    }
    const bool key = at > begin && at + 1 < end && document[at] == ':' &&
                     (std::isdigit(static_cast<unsigned char>(document[at + 1])) || document[at + 1] == '-');
    out.append(document, begin, (key ? at + 1 : end) - begin);
    if (key) out.append(" ").append(document, at + 1, end - at - 1);
    begin = end;
  }
  return out;
}

}  // namespace

const ConfigNode* ConfigNode::find(std::string_view key) const {
  const auto it = std::find(keys.begin(), keys.end(), key);
  return it == keys.end() ? nullptr : &items[it - keys.begin()];
}

Result<ConfigNode> parse_yaml(std::string_view text, const std::string& name) {
  // OpenCV's header is no directive of YAML. Blanking it keeps the numbers of the lines.
  std::string document(text);
  if (document.starts_with("%YAML:")) {
    document.replace(0, document.find('\n'), "");
    document = with_spaces_after_keys(document);
  }
  if (document.find('\0') != std::string::npos) return bad_input(name + ": binary data, text is allowed");
  const std::string excess = flow_excess(document);
  if (!excess.empty()) return bad_input(fmt::format("{}: {}", name, excess));
  try {
    std::istringstream stream(document);
    YAML::Parser parser(stream);
    TreeBuilder builder;
    if (!parser.HandleNextDocument(builder)) return bad_input(name + ": empty");
    return builder.take_root();
  } catch (const Refused& refused) {
    return bad_input(fmt::format("{}: {}", name, refused.reason));
  } catch (const YAML::Exception& e) {
    return bad_input(fmt::format("{}: line {}: no valid YAML: {}", name, e.mark.line + 1, e.msg));
  } catch (const std::exception& e) {
    return bad_input(fmt::format("{}: no valid YAML: {}", name, e.what()));
  }
}

}  // namespace raysfm
