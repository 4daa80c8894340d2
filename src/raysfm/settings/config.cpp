#include "raysfm/settings/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <type_traits>

#include "raysfm/files/config_tree.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxConfigBytes = 1 << 20;

template <typename T>
const char* kind_of() {
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  if constexpr (std::is_same_v<T, double>) return "a number";
  if constexpr (std::is_same_v<T, std::string>) return "a text";
  return "a whole number";
}

// Reads one configuration into the fields.
class ConfigReader {
 public:
  ConfigReader(const std::string& file, const std::vector<SettingField>& fields,
               const std::set<std::string>& given)
      : file_(file), fields_(fields), given_(given) {
    record_.file = file;
  }

  Result<ConfigRecord> read(const ConfigNode& root) {
    for (size_t i = 0; i < root.items.size(); ++i) {
      if (auto r = entry(root.keys[i], root.items[i]); !r) return r.error();
    }
    return std::move(record_);
  }

 private:
  template <typename... Parts>
  Error refused(const ConfigNode& node, fmt::format_string<Parts...> text, Parts&&... parts) const {
    return bad_input(
        fmt::format("{}: line {}: {}", file_, node.line, fmt::format(text, std::forward<Parts>(parts)...)));
  }

  Result<void> entry(const std::string& key, const ConfigNode& node) {
    if (key == "version") return version(node);
    if (key == "input") return inputs(node);
    const auto field = std::ranges::find(fields_, key, &SettingField::name);
    if (field == fields_.end()) {
      std::vector<std::string> names;
      for (const SettingField& known : fields_) names.push_back(known.name);
      return refused(node, "'{}' is no setting; allowed: {}", shown(key), fmt::join(names, ", "));
    }
    if (given_.contains(key)) return {};
    record_.lines[key] = node.line;
    return assign(*field, node);
  }

  Result<void> version(const ConfigNode& node) {
    if (node.kind != ConfigNode::Kind::kScalar) return refused(node, "version: must be a text");
    record_.version = node.text;
    return {};
  }

  Result<void> inputs(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::kScalar) record_.inputs = {node.text};
    const bool texts =
        node.kind != ConfigNode::Kind::kMap && std::ranges::all_of(node.items, [](const ConfigNode& part) {
          return part.kind == ConfigNode::Kind::kScalar;
        });
    if (!texts) return refused(node, "input: must be a list of texts");
    for (const ConfigNode& part : node.items) record_.inputs.push_back(part.text);
    return {};
  }

  Result<void> assign(const SettingField& field, const ConfigNode& node) const {
    return std::visit(
        [&](auto* target) -> Result<void> {
          using T = std::remove_pointer_t<decltype(target)>;
          const bool scalar = node.kind == ConfigNode::Kind::kScalar;
          const std::string text = scalar ? shown(node.text) : "(not a single value)";
          T value{};
          if (!scalar || !YAML::convert<T>::decode(YAML::Node(node.text), value)) {
            return refused(node, "{}: '{}' must be {}", field.name, text, kind_of<T>());
          }
          if constexpr (std::is_same_v<T, std::string>) {
            if (!field.allowed.empty() && std::ranges::find(field.allowed, value) == field.allowed.end()) {
              return refused(node, "{}: '{}' must be one of {}", field.name, text,
                             fmt::join(field.allowed, ", "));
            }
          }
          *target = value;
          return {};
        },
        field.value);
  }

  const std::string& file_;
  const std::vector<SettingField>& fields_;
  const std::set<std::string>& given_;
  ConfigRecord record_;
};

std::string yaml_quoted(const std::string& text) {
  YAML::Emitter out;
  out << YAML::DoubleQuoted << text;
  return out.c_str();
}

}  // namespace

Result<void> check_allowed(const std::vector<SettingField>& fields) {
  for (const SettingField& field : fields) {
    const auto* const* text = std::get_if<std::string*>(&field.value);
    if (!text || field.allowed.empty()) continue;
    if (std::ranges::find(field.allowed, **text) != field.allowed.end()) continue;
    return bad_input(
        fmt::format("--{} = '{}': must be one of {}", field.name, **text, fmt::join(field.allowed, ", ")));
  }
  return {};
}

Result<void> check_threads(int threads) {
  constexpr int kMaxThreads = 1024;
  if (threads >= 0 && threads <= kMaxThreads) return {};
  return bad_input(fmt::format("--threads = {}: must be 0 to {}", threads, kMaxThreads));
}

Result<ConfigRecord> read_config(const std::filesystem::path& path, const std::vector<SettingField>& fields,
                                 const std::set<std::string>& given) {
  const std::string file = path.string();
  const Result<std::string> text = read_text_file(path, kMaxConfigBytes);
  if (!text) return text.error();
  Result<ConfigNode> root = ConfigNode{};
  if (!content_lines(*text).empty()) root = parse_yaml(*text, file);
  if (!root) return root.error();
  if (root->kind != ConfigNode::Kind::kMap && root->kind != ConfigNode::Kind::kNull) {
    return bad_input(fmt::format("{}: must be a list of 'name: value' lines", file));
  }
  return ConfigReader(file, fields, given).read(*root);
}

Error where_it_was_set(Error error, const ConfigRecord& record) {
  const std::string& text = error.message;
  const size_t begin = text.starts_with("--") ? 2 : 0, end = text.find_first_of(" :", begin);
  const auto line = record.lines.find(text.substr(begin, end - begin));
  if (end == std::string::npos || line == record.lines.end()) return error;
  return {error.kind, fmt::format("{}: line {}: {}", record.file, line->second, text.substr(begin))};
}

std::string effective_config(const std::vector<SettingField>& fields, const std::vector<std::string>& inputs,
                             const std::string& version) {
  std::string out = fmt::format("version: {}\ninput:\n", yaml_quoted(version));
  for (const std::string& input : inputs) out += fmt::format("  - {}\n", yaml_quoted(input));
  for (const SettingField& field : fields) {
    std::visit(
        [&](auto* value) {
          if constexpr (std::is_same_v<decltype(value), std::string*>) {
            out += fmt::format("{}: {}\n", field.name, yaml_quoted(*value));
          } else {
            out += fmt::format("{}: {}\n", field.name, *value);
          }
        },
        field.value);
  }
  return out;
}

}  // namespace raysfm
