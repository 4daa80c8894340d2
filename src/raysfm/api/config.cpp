#include "raysfm/api/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <type_traits>

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

Result<void> assign(const std::filesystem::path& path, const SettingField& field, const YAML::Node& node) {
  return std::visit(
      [&](auto* target) -> Result<void> {
        using T = std::remove_pointer_t<decltype(target)>;
        const std::string text = node.IsScalar() ? node.Scalar() : "(not a single value)";
        T value{};
        if (!node.IsScalar() || !YAML::convert<T>::decode(node, value)) {
          return bad_input(
              fmt::format("{}: {}: '{}' must be {}", path.string(), field.name, text, kind_of<T>()));
        }
        if constexpr (std::is_same_v<T, std::string>) {
          if (!field.allowed.empty() && std::ranges::find(field.allowed, value) == field.allowed.end()) {
            return bad_input(fmt::format("{}: {}: '{}' must be one of {}", path.string(), field.name, value,
                                         fmt::join(field.allowed, ", ")));
          }
        }
        *target = value;
        return {};
      },
      field.value);
}

Result<void> read_record(const std::filesystem::path& path, const std::string& key, const YAML::Node& node,
                         ConfigRecord* record) {
  std::vector<std::string> texts;
  if (node.IsScalar()) texts.push_back(node.Scalar());
  for (const auto& part : node) {
    if (part.IsDefined() && part.IsScalar()) texts.push_back(part.Scalar());
  }
  const bool no_inputs = key == "input" && node.IsNull();
  const size_t parts = node.IsSequence() ? node.size() : no_inputs ? 0 : 1;
  if (texts.size() != parts || (key == "version" && !node.IsScalar())) {
    return bad_input(
        fmt::format("{}: {}: must be {}", path.string(), key, key == "input" ? "a list of texts" : "a text"));
  }
  if (key == "version") {
    record->version = texts[0];
  } else {
    record->inputs = std::move(texts);
  }
  return {};
}

Result<ConfigRecord> read_entries(const std::filesystem::path& path, const YAML::Node& root,
                                  const std::vector<SettingField>& fields,
                                  const std::set<std::string>& given) {
  ConfigRecord record;
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
    if (!seen.insert(key).second) return bad_input(fmt::format("{}: {}: given twice", path.string(), key));
    const auto field = std::ranges::find(fields, key, &SettingField::name);
    Result<void> read;
    if (key == "version" || key == "input") {
      read = read_record(path, key, entry.second, &record);
    } else if (field == fields.end()) {
      std::vector<std::string> names;
      for (const SettingField& known : fields) names.push_back(known.name);
      read = bad_input(
          fmt::format("{}: '{}' is no setting; allowed: {}", path.string(), key, fmt::join(names, ", ")));
    } else if (!given.contains(key)) {
      read = assign(path, *field, entry.second);
    }
    if (!read) return read.error();
  }
  return record;
}

std::string yaml_quoted(const std::string& text) {
  YAML::Emitter out;
  out << YAML::DoubleQuoted << text;
  return out.c_str();
}

}  // namespace

std::vector<SettingField> setting_fields(TrackSettings& s) {
  OdometryOptions& o = s.odometry;
  return {
      {"camera", "camera file; default: the one beside the images", &s.camera, {}},
      {"fps", "frames per second of images without timestamps", &s.fps, {}},
      {"mono", "use only the first camera of a stereo layout", &s.mono, {}},
      {"seed", "seed of every random choice", &o.seed, {}},
      {"threads", "worker threads; 0 for as many as the machine has", &s.threads, {}},
      {"error", "residual that is minimised", &s.error, {"auto", "pixel", "angular", "angular-plain"}},
      {"start", "how the first views are posed", &s.start, {"auto", "five-point", "pless"}},
      {"final", "adjustment of everything at the end", &s.final, {"none", "global"}},
      {"features", "corners per frame", &o.features, {}},
      {"min-matches", "fewer matches with the last key frame ask for a new one", &o.min_matches, {}},
      {"free-cameras", "key frames that a local adjustment moves", &o.free_cameras, {}},
      {"window", "key frames that a local adjustment observes", &o.window, {}},
      {"global-until", "key frames up to which everything is adjusted", &o.global_until, {}},
  };
}

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
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  if (error) return bad_input(fmt::format("{}: {}", path.string(), error.message()));
  if (size > kMaxConfigBytes) {
    return bad_input(
        fmt::format("{}: {} bytes; a configuration has at most {}", path.string(), size, kMaxConfigBytes));
  }
  try {
    const YAML::Node root = YAML::LoadFile(path.string());
    if (root.IsNull()) return ConfigRecord{};
    if (!root.IsMap())
      return bad_input(fmt::format("{}: must be a list of 'name: value' lines", path.string()));
    return read_entries(path, root, fields, given);
  } catch (const YAML::DeepRecursion&) {
    return bad_input(fmt::format("{}: not readable as YAML: nested too deeply", path.string()));
  } catch (const YAML::Exception& e) {
    return bad_input(fmt::format("{}:{}: not readable as YAML: {}", path.string(), e.mark.line + 1, e.msg));
  }
}

std::string effective_config(TrackSettings settings, const std::string& version) {
  return effective_config(setting_fields(settings), settings.inputs, version);
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
