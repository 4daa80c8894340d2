#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "commands.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/camera_files/camera_convert.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/camera_files/format_fit.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/plots/camera_plot.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct CameraOptions {
  std::string file;
  std::vector<int> size;       // of the images, where the file does not say it
  std::string plot;            // show
  std::string to, out, model;  // convert
  bool fit = false;
  std::vector<int> grid;
  std::string images, against;  // check
};

// The cameras of a file, with the size that the command line gives where the file has none; tells notes.
Result<Rig> read_rig(const std::string& file, const CameraOptions& options, const CommonOptions& common) {
  std::string note;
  Result<Rig> rig = read_camera_file(file, &note);
  if (!rig) return rig;
  for (Camera& camera : rig->cameras) {
    if (camera.width > 0 || options.size.empty()) continue;
    camera.width = options.size[0];
    camera.height = options.size[1];
  }
  if (!note.empty() && !common.quiet) std::fprintf(stderr, "%s: note: %s\n", file.c_str(), note.c_str());
  return rig;
}

std::string degrees(double value) {
  return std::isnan(value) ? "none" : fmt::format("{:.4g}", value);
}

std::string parameters_text(const CameraModel& model) {
  std::string text;
  for (const auto& [name, value] : camera_parameters(model)) {
    if (value != 0) text += fmt::format("{}{} {:.8g}", text.empty() ? "" : ", ", name, value);
  }
  return text.empty() ? "a table" : text;
}

std::string camera_text(const Camera& camera) {
  std::string text = fmt::format("{}: {}, ", camera.name, model_name(camera.model));
  text += camera.width > 0 ? fmt::format("{} x {}", camera.width, camera.height) : "size unknown";
  text += fmt::format(", stream {}\n  intrinsics       {}\n", camera.stream, parameters_text(camera.model));
  if (camera.roi.w > 0) {
    const Roi& roi = camera.roi;
    text += fmt::format("  roi              {} x {} at ({}, {})\n", roi.w, roi.h, roi.x, roi.y);
  }
  if (!camera.mask_path.empty()) text += fmt::format("  mask             {}\n", camera.mask_path);
  if (camera.width == 0) return text;
  const CameraFacts facts = camera_facts(camera);
  text += fmt::format("  field of view    {} x {} deg, diagonal {}; up to {} from the z axis\n",
                      degrees(facts.fov_horizontal_deg), degrees(facts.fov_vertical_deg),
                      degrees(facts.fov_diagonal_deg), degrees(facts.max_angle_deg));
  text += fmt::format("  pixels/degree    {} in the middle, {} to {} over the image\n",
                      degrees(facts.centre_pixels_per_degree), degrees(facts.min_pixels_per_degree),
                      degrees(facts.max_pixels_per_degree));
  text += fmt::format("  pixels with ray  {:.1f} %\n", 100 * facts.valid_share);
  text += fmt::format("  rays             {}{}, {}\n", facts.central ? "central" : "non-central",
                      facts.mirrored ? ", mirrored" : "",
                      camera.can_project() ? "projects by formula" : "projects by search");
  return text;
}

// "non-axial, 4 cameras"
std::string rig_class(const Rig& rig) {
  return fmt::format("{}, {} {}", to_string(camera_class(rig)), rig.cameras.size(),
                     rig.cameras.size() == 1 ? "camera" : "cameras");
}

std::string rig_text(const Rig& rig) {
  std::string text = fmt::format("rig: {}\n", rig_class(rig));
  const Camera& first = rig.cameras.front();
  for (size_t i = 1; i < rig.cameras.size(); ++i) {
    const Rigid3 pose = first.rig_from_cam.inverse() * rig.cameras[i].rig_from_cam;
    text += fmt::format("  {} - {}: baseline {:.6g}, rotation {:.4g} deg\n", first.name, rig.cameras[i].name,
                        pose.translation.norm(),
                        pose.rotation.angularDistance(Eigen::Quaterniond::Identity()) * 180 / M_PI);
  }
  for (const std::string& line : placements(rig)) text += fmt::format("  {}\n", line);
  return text;
}

Result<int> run_show(const CameraOptions& options, const CommonOptions& common) {
  const Result<Rig> rig = read_rig(options.file, options, common);
  if (!rig) return rig.error();
  if (!options.plot.empty()) {
    const std::string inputs[] = {options.file};
    if (auto r = check_not_input("--plot", options.plot, inputs); !r) return r.error();
    const Result<void> plotted = plot_cameras(*rig, options.plot);
    if (!plotted) {
      return Error{plotted.error().kind, fmt::format("{}: {}", options.file, plotted.error().message)};
    }
  }
  if (common.quiet) return 0;
  std::string text;
  for (const Camera& camera : rig->cameras) text += camera_text(camera);
  text += rig_text(*rig);
  if (!options.plot.empty()) text += fmt::format("plot: {}\n", options.plot);
  return printed(text);
}

Result<void> write_files(const std::vector<CameraFileText>& files, const CameraOptions& options) {
  const std::string &out = options.out, inputs[] = {options.file};
  if (files.size() == 1) {
    if (auto r = check_not_input("--out", out, inputs); !r) return r;
    return write_file(out, files.front().text);
  }
  std::error_code failure;
  std::filesystem::create_directories(out, failure);
  if (failure) return bad_input(fmt::format("{}: {}; allowed: a folder", out, failure.message()));
  Result<void> written;
  for (const CameraFileText& file : files) {
    const std::filesystem::path path = std::filesystem::path(out) / file.name;
    if (written) written = check_not_input("--out", path, inputs);
    if (written) written = write_file(path, file.text);
  }
  return written;
}

Result<int> run_convert(const CameraOptions& options, const CommonOptions& common) {
  std::string format = options.to;
  ModelChoice choice = {options.model, options.fit};
  if (!options.grid.empty()) choice.grid = {options.grid[0], options.grid[1]};
  if (format == "ray-table") {
    format = "raysfm";
    choice.model = "ray-table";
    choice.fit = true;
  }
  Result<Rig> rig = read_rig(options.file, options, common);
  if (!rig) return rig.error();
  std::string report;
  for (Camera& camera : rig->cameras) {
    if (camera.width == 0) {
      return bad_input(fmt::format("{}: {}: resolution: missing; allowed: --size WIDTH HEIGHT", options.file,
                                   camera.name));
    }
    if (format == "raysfm" && choice.model.empty()) continue;
    const Result<std::string> converted = bring_to_format(format, choice, &camera);
    if (!converted) return bad_input(fmt::format("{}: {}", options.file, converted.error().message));
    report += *converted;
  }
  const Result<std::vector<CameraFileText>> files = format_cameras(*rig, format);
  if (!files) return bad_input(fmt::format("{}: {}", options.file, files.error().message));
  if (!common.quiet) std::fputs(report.c_str(), stderr);
  if (!options.out.empty()) {
    const Result<void> written = write_files(*files, options);
    if (!written) return written.error();
    return 0;
  }
  std::string text;
  for (const CameraFileText& file : *files)
    text += files->size() > 1 ? file.name + ":\n" + file.text : file.text;
  return printed(text);
}

Result<std::string> comparison_text(const Rig& rig, const CameraOptions& options,
                                    const CommonOptions& common) {
  const Result<Rig> other = read_rig(options.against, options, common);
  if (!other) return other.error();
  std::string text;
  const size_t count = std::min(rig.cameras.size(), other->cameras.size());
  for (size_t i = 0; i < count; ++i) {
    const Result<CameraComparison> c = compare_cameras(rig.cameras[i], other->cameras[i]);
    if (!c)
      return bad_input(fmt::format("{}: {}: {}", options.against, other->cameras[i].name, c.error().message));
    text += fmt::format(
        "{} - {}: rays differ by {:.3g} px (median), {:.3g} (95 %), {:.3g} (max), {} rays, common rotation "
        "{:.3g} deg\n",
        rig.cameras[i].name, other->cameras[i].name, c->median_px, c->p95_px, c->max_px, c->rays,
        c->rotation_deg);
  }
  for (size_t i = 1; i < count; ++i) {
    const Rigid3 a = rig.cameras[0].rig_from_cam.inverse() * rig.cameras[i].rig_from_cam;
    const Rigid3 b = other->cameras[0].rig_from_cam.inverse() * other->cameras[i].rig_from_cam;
    text += fmt::format("{} - {}: places differ by {:.3g}, rotations by {:.3g} deg\n", rig.cameras[0].name,
                        rig.cameras[i].name, (a.translation - b.translation).norm(),
                        a.rotation.angularDistance(b.rotation) * 180 / M_PI);
  }
  return text;
}

// What is wrong with the masks of the cameras, one sentence each.
std::vector<std::string> mask_warnings(const Rig& rig) {
  std::vector<std::string> warnings;
  for (const Camera& camera : rig.cameras) {
    if (camera.mask_path.empty() || camera.width == 0) continue;
    const Result<GrayImage> mask = read_mask(camera.mask_path, camera.width, camera.height);
    if (!mask) {
      warnings.push_back(camera.name + ": " + mask.error().message);
      continue;
    }
    bool sees = false;
    for (int y = 0; y < mask->height(); ++y) {
      sees = sees || std::any_of(mask->row(y), mask->row(y) + mask->width(), [](uint8_t m) { return m > 0; });
    }
    if (!sees)
      warnings.push_back(camera.name + ": " + camera.mask_path + ": no pixel of the mask sees the scene");
  }
  return warnings;
}

Result<int> run_check(const CameraOptions& options, const CommonOptions& common) {
  Result<Rig> rig = read_rig(options.file, options, common);
  if (!rig) return rig.error();
  std::string text;
  if (!options.images.empty()) {
    const Result<Input> input = open_input({options.images}, {0, false, true});
    if (!input) return input.error();
    std::string note;
    rig = rig_for_streams(*std::move(rig), input->streams, &note);
    if (!rig) return bad_input(fmt::format("{}: {}", options.file, rig.error().message));
    if (!note.empty()) text += "warning: " + note + "\n";
    text += fmt::format("images: {} streams, their sizes are those of the cameras\n", input->streams.size());
  }
  text += rig_class(*rig) + "\n";
  std::vector<std::string> warnings = camera_warnings(*rig);
  for (std::string& warning : mask_warnings(*rig)) warnings.push_back(std::move(warning));
  for (const std::string& warning : warnings) text += "warning: " + warning + "\n";
  if (warnings.empty()) text += "no warnings\n";
  for (const std::string& place : placements(*rig)) {
    text +=
        "check: is it true that " + place + "? A pose given the wrong way round looks as good to a program\n";
  }
  if (!options.against.empty()) {
    const Result<std::string> compared = comparison_text(*rig, options, common);
    if (!compared) return compared.error();
    text += *compared;
  }
  return common.quiet ? Result<int>(0) : printed(text);
}

CLI::App* add_command(CLI::App& camera, const char* name, const char* help,
                      const std::shared_ptr<CameraOptions>& options) {
  CLI::App* command = camera.add_subcommand(name, help);
  command->add_option("FILE", options->file, "camera file of any known format")->required();
  command->add_option("--size", options->size, "size of the images, where the file does not say it")
      ->expected(2)
      ->check(CLI::Range(1, 32768))
      ->type_name("WIDTH HEIGHT");
  return command;
}

}  // namespace

Command add_camera(CLI::App& program, const CommonOptions& common) {
  auto options = std::make_shared<CameraOptions>();
  CLI::App* camera =
      program.add_subcommand("camera", "calibrate cameras; look at, convert and check camera files");
  camera->require_subcommand(1);

  CLI::App* show = add_command(*camera, "show", "what the cameras of a file see", options);
  show->add_option("--plot", options->plot, "draw rays, resolution and field of view")->type_name("FILE.png");

  CLI::App* convert = add_command(*camera, "convert", "write the cameras in another format", options);
  std::vector<std::string> formats(camera_formats().begin(), camera_formats().end());
  formats.push_back("ray-table");
  convert->add_option("--to", options->to, "format of the new file")
      ->required()
      ->check(CLI::IsMember(formats));
  convert
      ->add_option("--out", options->out, "new file, or folder where the format has several; default: print")
      ->type_name("PATH");
  convert->add_option("--model", options->model,
                      "camera model of the new file; default: the same where possible");
  convert->add_flag("--fit", options->fit, "take the nearest camera where no formula leads to the model");
  convert->add_option("--grid", options->grid, "control points of a ray table")
      ->expected(2)
      ->check(CLI::Range(4, 1024))
      ->type_name("WIDTH HEIGHT");

  CLI::App* check = add_command(*camera, "check", "look for what is wrong or suspicious in a file", options);
  check->add_option("--images", options->images,
                    "video or folder whose images the cameras should have taken");
  check->add_option("--against", options->against, "another file for the same cameras, to compare the rays")
      ->type_name("FILE");

  const Command calibrate = add_calibrate(*camera, common);

  return [=, &common]() -> Result<int> {
    if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
    if (camera->got_subcommand("calibrate")) return calibrate();
    if (*show) return run_show(*options, common);
    if (*convert) return run_convert(*options, common);
    return run_check(*options, common);
  };
}

}  // namespace raysfm::app
