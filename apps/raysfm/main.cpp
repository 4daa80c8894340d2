#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <memory>
#include <new>
#include <string>

#include "build_facts.h"
#include "commands.h"
#include "options_text.h"
#include "raysfm/core/heap.h"
#include "raysfm/page/page.h"
#include "raysfm/results/output_folder.h"
#include "terminal.h"

namespace {

int exit_code(raysfm::ErrorKind kind) {
  switch (kind) {
    case raysfm::ErrorKind::kBadInput:
      return 2;
    case raysfm::ErrorKind::kNoReconstruction:
      return 3;
    case raysfm::ErrorKind::kInternal:
      return 1;
  }
  return 1;
}

std::terminate_handler usual_end = nullptr;

// A library that is being loaded lets nothing through that it throws.
void on_terminate() {
  try {
    if (const std::exception_ptr thrown = std::current_exception()) std::rethrow_exception(thrown);
  } catch (const std::bad_alloc&) {
    std::fputs("raysfm: not enough memory\n", stderr);
    std::_Exit(1);
  } catch (...) {
  }
  usual_end();
}

// Where memory ends in the middle of a computation nobody can tell what it was for.
raysfm::Result<int> within_memory(const raysfm::app::Command& command) try {
  return command();
} catch (const std::bad_alloc&) {
  return raysfm::internal_error("not enough memory");
}

// A negative number would be taken for a large one, and a larger one for the largest.
CLI::Validator seed_check() {
  return {[](std::string& text) {
            uint64_t seed = 0;
            const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), seed);
            const bool whole = failure == std::errc() && end == text.data() + text.size();
            return whole ? std::string() : text + " is not allowed, 0 to 18446744073709551615 are";
          },
          ""};
}

// For those who build packages: texts that are made from the options.
raysfm::app::Command add_options(CLI::App& program) {
  auto format = std::make_shared<std::string>();
  CLI::App* command = program.add_subcommand("options", "manual page or completion of a shell")->group("");
  command->add_option("FORMAT", *format)->required()->check(CLI::IsMember({"man", "bash", "zsh"}));
  return [format, &program] {
    if (*format == "man") return raysfm::app::printed(raysfm::app::man_page(program, RAYSFM_VERSION));
    return raysfm::app::printed(*format == "bash" ? raysfm::app::bash_completion(program)
                                                  : raysfm::app::zsh_completion(program));
  };
}

int run(int argc, char** argv) {
  using namespace raysfm::app;
  CLI::App program{"raysfm: camera poses and a map from video, whatever the camera", "raysfm"};
  program.set_version_flag("--version", build_facts, "version, and how this was built");
  program.require_subcommand(1);
  program.failure_message([](const CLI::App*, const CLI::Error& e) {
    return std::string("raysfm: ") + e.what() + " (--help tells what is)\n";
  });
  program.fallthrough();

  CommonOptions common;
  program.add_flag("--quiet", common.quiet, "print nothing but errors");
  program.add_option("--threads", common.threads, "worker threads; 0 for as many as the machine has")
      ->check(CLI::Range(0, 1024));
  program.add_option("--seed", common.seed, "seed of every random choice")->check(seed_check());
  program.add_option("--config", common.config, "YAML file with options; flags win over it");

  const std::pair<const char*, Command> commands[] = {
      {"track", add_track(program, common)},   {"adjust", add_adjust(program, common)},
      {"solve", add_solve(program, common)},   {"eval", add_eval(program, common)},
      {"synth", add_synth(program, common)},   {"camera", add_camera(program, common)},
      {"export", add_export(program, common)}, {"view", add_view(program, common)},
      {"map", add_map(program, common)},       {"join", add_join(program, common)},
      {"batch", add_batch(program, common)},   {"options", add_options(program)},
  };

  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (program.exit(e) != 0) return 2;
    if (std::cout.flush()) return 0;
    std::fputs("raysfm: standard output cannot be written\n", stderr);
    return 2;
  }
  for (const auto& [name, command] : commands) {
    if (!program.got_subcommand(name)) continue;
    const raysfm::Result<int> result = within_memory(command);
    if (result) return *result;
    std::fprintf(stderr, "raysfm %s: %s\n", name, result.error().message.c_str());
    return exit_code(result.error().kind);
  }
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  raysfm::prepare_heap();
  // A limit of file sizes is an error of writing like a full disk.
  std::signal(SIGXFSZ, SIG_IGN);
  usual_end = std::set_terminate(on_terminate);
  if (raysfm::has_page()) raysfm::set_page_writer(raysfm::write_page);
  try {
    return run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "raysfm: internal error: %s\n", e.what());
    return 1;
  }
}
