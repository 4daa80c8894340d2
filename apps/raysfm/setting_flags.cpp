#include "setting_flags.h"

#include <fmt/format.h>

#include <cstdio>
#include <set>
#include <type_traits>
#include <variant>

namespace raysfm::app {
namespace {

bool is_common(const SettingField& field) {
  return field.name == "seed" || field.name == "threads";
}

void add_flag(CLI::App& command, const SettingField& field) {
  const std::string flag = "--" + field.name;
  std::visit(
      [&](auto* value) {
        if constexpr (std::is_same_v<decltype(value), bool*>) {
          command.add_flag(flag, *value, field.help);
        } else {
          CLI::Option* option = command.add_option(flag, *value, field.help);
          if constexpr (std::is_same_v<decltype(value), std::string*>) {
            if (!field.allowed.empty()) option->check(CLI::IsMember(field.allowed));
            if (value->empty()) return;
          }
          option->capture_default_str();
        }
      },
      field.value);
}

}  // namespace

void add_setting_flags(CLI::App& command, const std::vector<SettingField>& fields) {
  for (const SettingField& field : fields) {
    if (!is_common(field)) add_flag(command, field);
  }
}

Result<ConfigRecord> settle_settings(const std::vector<SettingField>& fields, const CLI::App& command,
                                     const CLI::App& program, const CommonOptions& common,
                                     std::vector<std::string>* inputs) {
  std::set<std::string> given;
  for (const SettingField& field : fields) {
    const CLI::App& owner = is_common(field) ? program : command;
    if (owner.count("--" + field.name) > 0) given.insert(field.name);
    if (field.name == "seed") *std::get<uint64_t*>(field.value) = common.seed;
    if (field.name == "threads") *std::get<int*>(field.value) = common.threads;
  }
  ConfigRecord record;
  if (!common.config.empty()) {
    Result<ConfigRecord> read = read_config(common.config, fields, given);
    if (!read) return read.error();
    record = *std::move(read);
  }
  if (!common.quiet && !record.version.empty() && record.version != RAYSFM_VERSION) {
    std::fprintf(stderr, "warning: %s is of version %s, this is %s\n", common.config.c_str(),
                 record.version.c_str(), RAYSFM_VERSION);
  }
  if (!inputs) return record;
  if (inputs->empty()) *inputs = record.inputs;
  if (inputs->empty()) return bad_input("INPUT is missing; allowed: on the command line, or in --config");
  return record;
}

Result<ConfigRecord> settle_settings(const std::vector<SettingField>& fields, const CLI::App& command,
                                     const CLI::App& program, const CommonOptions& common,
                                     std::string* input) {
  std::vector<std::string> inputs;
  if (!input->empty()) inputs.push_back(*input);
  Result<ConfigRecord> record = settle_settings(fields, command, program, common, &inputs);
  if (!record) return record;
  if (inputs.size() > 1) {
    return bad_input(fmt::format("{}: input: {} of them, one is allowed", common.config, inputs.size()));
  }
  *input = inputs[0];
  return record;
}

CLI::Validator named() {
  return {[](std::string& name) { return std::string(name.empty() ? "an empty name is not allowed" : ""); },
          ""};
}

}  // namespace raysfm::app
