#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "commands.h"
#include "live_view.h"
#include "page_server.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/page/frame_features.h"
#include "raysfm/page/frame_pictures.h"
#include "raysfm/page/page.h"
#include "raysfm/page/page_mesh.h"
#include "raysfm/results/reconstruction_folder.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

struct ViewArguments {
  std::string result, html, port, mesh;
  std::vector<std::string> images;
};

// The surface that was asked for, or else lies beside the result; an older or damaged one that nobody asked
// for is nothing but a note.
Result<std::optional<PageMesh>> mesh_of(const ViewArguments& arguments, const CommonOptions& common) {
  const fs::path folder =
      arguments.mesh.empty() ? mesh_folder_of(arguments.result) : fs::path(arguments.mesh);
  if (folder.empty()) return std::optional<PageMesh>();
  Result<PageMesh> mesh = read_page_mesh(folder);
  if (mesh) return std::optional<PageMesh>(*std::move(mesh));
  if (!arguments.mesh.empty()) return mesh.error();
  if (!common.quiet)
    std::fprintf(stderr, "raysfm view: note: no surface: %s\n", mesh.error().message.c_str());
  return std::optional<PageMesh>();
}

Result<int> write_html(const ViewArguments& arguments, const CommonOptions& common) {
  const std::string inputs[] = {arguments.result + "/report.json", arguments.result + "/points.ply",
                                arguments.result + "/trajectory.txt"};
  if (auto r = check_not_input("--html", arguments.html, inputs); !r) return r.error();
  const Result<Reconstruction> result = read_reconstruction(arguments.result);
  if (!result) return result.error();
  Result<std::optional<PageMesh>> mesh = mesh_of(arguments, common);
  if (!mesh) return mesh.error();
  PageInfo info = read_page_info(arguments.result);
  info.mesh = *std::move(mesh);
  const Result<std::string> html = page_html(*result, info, false);
  if (!html) return html.error();
  if (auto r = write_file(arguments.html, *html); !r) return r.error();
  if (!common.quiet) std::printf("written to %s; open it in a browser\n", arguments.html.c_str());
  return 0;
}

// A result and the pictures that it was made of.
struct ServedResult {
  Reconstruction reconstruction;
  FrameFeatures features;
  FramePictures pictures;
  PageInfo info;

  ServedResult(Reconstruction r, std::vector<std::string> inputs)
      : reconstruction(std::move(r)),
        features(reconstruction),
        pictures(std::move(inputs), reconstruction.rig.cameras.size() <= 1, reconstruction.range) {}

  PageAnswers answers() {
    PageAnswers answers;
    answers.page = [this] { return page_html(reconstruction, info, true); };
    if (info.pictures == 0) return answers;
    answers.picture = [this](int frame, int camera) { return pictures.jpeg(frame, camera); };
    answers.features = [this](int frame, int camera) { return features.json(frame, camera); };
    return answers;
  }
};

Result<int> serve(const ViewArguments& arguments, const CommonOptions& common) {
  const Result<ServerAddress> address =
      arguments.port.empty() ? ServerAddress() : parse_server_address("--port", arguments.port);
  if (!address) return address.error();
  if (!has_page()) return bad_input("this build has no page: npm was not there when it was made");
  Result<Reconstruction> result = read_reconstruction(arguments.result);
  if (!result) return result.error();
  const StopSignals stop;
  ServedResult served(*std::move(result),
                      arguments.images.empty() ? inputs_of_result(arguments.result) : arguments.images);
  served.info = read_page_info(arguments.result);
  Result<std::optional<PageMesh>> mesh = mesh_of(arguments, common);
  if (!mesh) return mesh.error();
  served.info.mesh = *std::move(mesh);
  const Result<void> opened = served.pictures.open();
  if (!opened && !arguments.images.empty()) return opened.error();
  if (opened) served.info.pictures = served.pictures.streams();
  const Result<std::unique_ptr<PageServer>> server = start_page_server(*address, served.answers());
  if (!server) return server.error();
  if (!common.quiet) {
    if (!opened)
      std::fprintf(stderr, "raysfm view: note: no pictures of frames: %s\n", opened.error().message.c_str());
    std::printf("served at %s until Ctrl-C\n", (*server)->url().c_str());
    std::fflush(stdout);
  }
  while (!stop.requested()->load()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return 0;
}

Result<int> run_view(const ViewArguments& arguments, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  return arguments.html.empty() ? serve(arguments, common) : write_html(arguments, common);
}

}  // namespace

Command add_view(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<ViewArguments>();
  CLI::App* command = program.add_subcommand("view", "a finished result as a page for the browser");
  command->add_option("DIR", arguments->result, "output folder of track, solve or adjust")->required();
  CLI::Option* port = command
                          ->add_option("--port", arguments->port,
                                       "where it is served; without an address only this machine can look")
                          ->type_name("[ADDRESS:]PORT");
  command
      ->add_option("--mesh", arguments->mesh,
                   "folder of export --format mesh to show too; default: DIR-mesh, where it is there")
      ->type_name("PATH");
  command
      ->add_option("--images", arguments->images,
                   "video or folder of the frames, where they are not where the run found them")
      ->type_name("PATH");
  command->add_option("--html", arguments->html, "file to write instead, which needs no network")
      ->excludes(port)
      ->type_name("FILE");
  return [arguments, &common] { return run_view(*arguments, common); };
}

}  // namespace raysfm::app
