#include "options_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

namespace raysfm::app {
namespace {

// A command or one of its own, e.g. "camera show"; the program itself has no name.
struct CommandNode {
  std::string name;
  const CLI::App* app;
};

// Those that are shown, each behind the one that it belongs to.
std::vector<CommandNode> commands_of(const CLI::App& program) {
  std::vector<CommandNode> nodes = {{"", &program}};
  for (size_t i = 0; i < nodes.size(); ++i) {
    const CommandNode node = nodes[i];
    size_t place = i + 1;
    for (const CLI::App* sub : node.app->get_subcommands([](const CLI::App*) { return true; })) {
      if (sub->get_group().empty()) continue;
      const std::string name = node.name.empty() ? sub->get_name() : node.name + " " + sub->get_name();
      nodes.insert(nodes.begin() + static_cast<std::ptrdiff_t>(place++), {name, sub});
    }
  }
  return nodes;
}

bool takes_value(const CLI::Option& option) {
  return option.get_items_expected_max() > 0;
}

std::vector<const CLI::Option*> flags_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option* o) { return o->nonpositional() && !o->get_group().empty(); });
}

// "-h" and "--help"
std::vector<std::string> names_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

// What an option may be, where that is a list: CLI11 has it in the name of the type, TEXT:{a,b}.
std::vector<std::string> allowed_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const size_t begin = type.find('{'), end = type.rfind('}');
  if (begin == std::string::npos || end == std::string::npos) return {};
  return CLI::detail::split(type.substr(begin + 1, end - begin - 1), ',');
}

std::string value_name(const CLI::Option& option) {
  const std::vector<std::string> allowed = allowed_of(option);
  if (!allowed.empty()) return fmt::format("{}", fmt::join(allowed, "|"));
  const std::string type = option.get_type_name();
  size_t end = type.find(':');  // what CLI11 says of checks begins there, but in [ADDRESS:]PORT
  while (end != std::string::npos && type[end + 1] == ']') end = type.find(':', end + 1);
  return type.substr(0, end);
}

// Text as the formatter of manual pages takes it.
std::string roff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  return !out.empty() && (out[0] == '.' || out[0] == '\'') ? "\\&" + out : out;
}

std::string option_entry(const CLI::Option& option) {
  std::string entry =
      fmt::format(".TP\n\\fB{}\\fR", roff(fmt::format("{}", fmt::join(names_of(option), ", "))));
  if (takes_value(option)) entry += fmt::format(" \\fI{}\\fR", roff(value_name(option)));
  entry += "\n" + roff(option.get_description());
  if (!option.get_default_str().empty())
    entry += roff(fmt::format(" (default: {})", option.get_default_str()));
  return entry + "\n";
}

std::string command_entry(const CommandNode& node) {
  std::string line = "raysfm " + node.name, inputs;
  for (const CLI::Option* option :
       node.app->get_options([](const CLI::Option* o) { return o->get_positional(); })) {
    const std::string name = option->get_name(true);
    line += " " + name + (option->get_items_expected_max() > 1 ? "..." : "");
    inputs += fmt::format(".TP\n\\fI{}\\fR\n{}\n", roff(name), roff(option->get_description()));
  }
  std::string entry = fmt::format(".SS {}\n{}\n", roff(line), roff(node.app->get_description()));
  if (!node.app->get_footer().empty()) entry += ".PP\n" + roff(node.app->get_footer()) + "\n";
  entry += inputs;
  for (const CLI::Option* option : flags_of(*node.app)) {
    if (option != node.app->get_help_ptr()) entry += option_entry(*option);
  }
  return entry;
}

// The tables of a completion: which command the words before make, what a flag may be, what a command has.
struct CompletionTables {
  std::string commands, values, words;
};

std::string words_of(const CommandNode& node, const CLI::App& program) {
  std::vector<std::string> words;
  for (const CLI::App* sub : node.app->get_subcommands([](const CLI::App*) { return true; })) {
    if (!sub->get_group().empty()) words.push_back(sub->get_name());
  }
  for (const CLI::App* app : {node.app, &program}) {
    for (const CLI::Option* option : flags_of(*app)) {
      for (std::string& name : names_of(*option)) words.push_back(std::move(name));
    }
    if (app == &program) break;
  }
  std::ranges::stable_sort(words);
  words.erase(std::unique(words.begin(), words.end()), words.end());
  return fmt::format("{}", fmt::join(words, " "));
}

CompletionTables tables_of(const CLI::App& program, const std::string& offer) {
  CompletionTables tables;
  for (const CommandNode& node : commands_of(program)) {
    const size_t space = node.name.rfind(' ');
    const std::string parent = space == std::string::npos ? "" : node.name.substr(0, space);
    const std::string last = space == std::string::npos ? node.name : node.name.substr(space + 1);
    const bool family = !node.app->get_subcommands([](const CLI::App*) { return true; }).empty();
    if (!last.empty()) {
      tables.commands += fmt::format("      '{}:{}') command='{}' family='{}' ;;\n", parent, last, node.name,
                                     family ? "yes" : "");
    }
    for (const CLI::Option* option : flags_of(*node.app)) {
      const std::vector<std::string> allowed = allowed_of(*option);
      for (const std::string& name : names_of(*option)) {
        if (allowed.empty()) continue;
        tables.values += fmt::format("    '{}:{}') {} ;;\n", node.name, name,
                                     fmt::format(fmt::runtime(offer), fmt::join(allowed, " ")));
      }
    }
    tables.words += fmt::format("    '{}') {} ;;\n", node.name,
                                fmt::format(fmt::runtime(offer), words_of(node, program)));
  }
  return tables;
}

}  // namespace

std::string man_page(const CLI::App& program, const std::string& version) {
  std::string page = fmt::format(
      ".TH RAYSFM 1 \"\" \"raysfm {}\" \"User Commands\"\n.SH NAME\nraysfm \\- camera poses and a map from "
      "video, "
      "whatever the camera\n.SH SYNOPSIS\n\\fBraysfm\\fR \\fICOMMAND\\fR [\\fIOPTION\\fR]...\n.SH OPTIONS\n",
      version);
  for (const CLI::Option* option : flags_of(program)) page += option_entry(*option);
  page += ".SH COMMANDS\n";
  for (const CommandNode& node : commands_of(program)) {
    if (!node.name.empty()) page += command_entry(node);
  }
  return page +
         ".SH EXIT STATUS\n0 done, 2 bad input (one line says what), 3 no reconstruction (one line says "
         "why), 1 a "
         "fault of the program, 129, 130, 141 and 143 ended by a signal, with everything so far written.\n";
}

std::string bash_completion(const CLI::App& program) {
  const CompletionTables tables = tables_of(program, "words='{}'");
  return fmt::format(R"(# Completion of raysfm for bash, made from its options.
_raysfm() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} command='' family=yes word words=''
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$command:$word" in
{}    esac
  done
  case "$command:$before" in
{}  esac
  [[ -n $words || (-z $family && $current != -*) ]] || case "$command" in
{}  esac
  COMPREPLY=()
  [[ -z $words ]] || mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
}}
complete -o bashdefault -o default -F _raysfm raysfm
)",
                     tables.commands, tables.values, tables.words);
}

std::string zsh_completion(const CLI::App& program) {
  const CompletionTables tables = tables_of(program, "offered=({})");
  return fmt::format(R"(#compdef raysfm
# Completion of raysfm for zsh, made from its options.
local command='' family=yes word
local -a offered
for word in "${{(@)words[2,CURRENT-1]}}"; do
    case "$command:$word" in
{}    esac
done
case "$command:${{words[CURRENT-1]}}" in
{}esac
if (( ! $#offered )) && [[ -n $family || $PREFIX == -* ]]; then
  case "$command" in
{}  esac
fi
if (( $#offered )); then
  compadd -- $offered
else
  _files
fi
)",
                     tables.commands, tables.values, tables.words);
}

}  // namespace raysfm::app
