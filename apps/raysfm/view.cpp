#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/page/page.h"
#include "raysfm/results/reconstruction_folder.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string result, html;
};

// The name of the folder, also of "." and "out/".
std::string title_of(const fs::path& folder) {
  std::error_code failure;
  const fs::path whole = fs::canonical(folder, failure);
  return (failure ? folder : whole).filename().string();
}

Result<int> run(const Arguments& arguments, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  const std::string inputs[] = {arguments.result + "/report.json", arguments.result + "/points.ply",
                                arguments.result + "/trajectory.txt"};
  if (auto r = check_not_input("--html", arguments.html, inputs); !r) return r.error();
  const Result<Reconstruction> result = read_reconstruction(arguments.result);
  if (!result) return result.error();
  if (auto r = write_page(*result, title_of(arguments.result), arguments.html); !r) return r.error();
  if (!common.quiet) std::printf("written to %s; open it in a browser\n", arguments.html.c_str());
  return 0;
}

}  // namespace

Command add_view(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = program.add_subcommand("view", "a finished result as a page for the browser");
  command->add_option("DIR", arguments->result, "output folder of track, solve or adjust")->required();
  command->add_option("--html", arguments->html, "file to write, which needs no network")
      ->required()
      ->type_name("FILE");
  return [arguments, &common] { return run(*arguments, common); };
}

}  // namespace raysfm::app
