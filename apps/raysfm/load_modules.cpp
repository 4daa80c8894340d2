// The functions of the library that the modules of the program and of the Python package hold: each loads its
// module first.
#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "modules/modules.h"
#include "modules/server_module.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

// The shared library that this is a part of; empty: the program.
fs::path own_library() {
  static const char here = 0;
  Dl_info info;
  void* map = nullptr;
  const bool known = dladdr1(&here, &info, &map, RTLD_DL_LINKMAP) != 0;
  const char* name = known ? static_cast<const link_map*>(map)->l_name : "";
  std::error_code failure;
  return *name ? fs::absolute(name, failure) : fs::path();
}

// Found when it is loaded: a relative path of a library holds until somebody changes the folder.
const fs::path library_of_this = own_library();

fs::path folder_of_this() {
  std::error_code failure;
  const bool program = library_of_this.empty();
  return (program ? fs::read_symlink("/proc/self/exe", failure) : library_of_this).parent_path();
}

// Beside this as it is built, or where it is installed.
fs::path module_path(const char* file) {
  std::error_code failure;
  const fs::path beside = folder_of_this() / file;
  return fs::exists(beside, failure) ? beside : folder_of_this() / RAYSFM_MODULE_FOLDER / file;
}

// Never unloaded: objects of the module's classes live as long as they like.
template <typename Module>
Result<const Module*> load() {
  const fs::path path = module_path(Module::kFile);
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  const void* table = library ? dlsym(library, Module::kSymbol) : nullptr;
  // The program does not print through std::cerr, but OpenCV does.
  if (library_of_this.empty()) std::cerr.rdbuf(nullptr);
  if (table) return static_cast<const Module*>(table);
  const char* reason = dlerror();
  if (reason && std::string_view(reason).find("failed to map segment") != std::string_view::npos) {
    return internal_error(fmt::format("not enough memory to load a part of the program: {}", reason));
  }
  return internal_error(
      fmt::format("a part of the program cannot be loaded: {}", reason ? reason : path.string()));
}

template <typename Module, typename Function, typename... Args>
auto call(Function Module::*function, Args&&... args)
    -> decltype((std::declval<Module>().*function)(std::forward<Args>(args)...)) {
  static const Result<const Module*> module = load<Module>();
  if (!module) return module.error();
  return ((*module)->*function)(std::forward<Args>(args)...);
}

using app::DeviceModule, app::PictureModule, app::ServerModule, app::VideoModule;

}  // namespace

namespace app {

Result<std::unique_ptr<PageServer>> start_page_server(const ServerAddress& address, PageAnswers answers) {
  return call(&ServerModule::start_page_server, address, std::move(answers));
}

}  // namespace app

Result<DecodedImage> decode_other(const std::string& bytes) {
  return call(&PictureModule::decode_other, bytes);
}

Result<void> write_png(const fs::path& path, GrayView gray) {
  return call(&PictureModule::write_png, path, gray);
}

Result<void> write_color_png(const fs::path& path, ImageView<const uint8_t> bgr) {
  return call(&PictureModule::write_color_png, path, bgr);
}

Result<void> plot_cameras(const Rig& rig, const fs::path& path) {
  return call(&PictureModule::plot_cameras, rig, path);
}

Result<void> plot_lens(std::span<const LensOfFrame> lenses, const fs::path& path) {
  return call(&PictureModule::plot_lens, lenses, path);
}

Result<void> plot_evaluation(const Trajectory& estimate, const Trajectory& truth,
                             const Evaluation& evaluation, const fs::path& path) {
  return call(&PictureModule::plot_evaluation, estimate, truth, evaluation, path);
}

Result<std::unique_ptr<PhotoFeatures>> make_photo_features() {
  return call(&PictureModule::make_photo_features);
}

Result<std::vector<Eigen::Vector2d>> find_board_corners(const GrayView& image, int columns, int rows) {
  return call(&PictureModule::find_board_corners, image, columns, rows);
}

Result<std::array<int, 2>> guess_board_size(const GrayView& image) {
  return call(&PictureModule::guess_board_size, image);
}

Result<void> plot_boards(const BoardCalibration& calibration, const fs::path& path) {
  return call(&PictureModule::plot_boards, calibration, path);
}

Result<std::unique_ptr<FrameSource>> open_video(const std::string& path, const DecoderOptions& options) {
  return call(&VideoModule::open_video, path, options);
}

Result<std::unique_ptr<FrameSource>> open_device(const std::string& path, const DecoderOptions& options) {
  return call(&VideoModule::open_device, path, options);
}

Result<void> register_devices() {
  return call(&DeviceModule::register_devices);
}

}  // namespace raysfm
