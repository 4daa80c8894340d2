#include "modules.h"

namespace {

// The program says itself what is wrong with an image.
[[maybe_unused]] const bool silent = (raysfm::silence_opencv(), true);

}  // namespace

extern "C" const raysfm::app::PictureModule raysfm_picture_module = {
    raysfm::decode_other,        raysfm::write_png,          raysfm::write_color_png,
    raysfm::plot_cameras,        raysfm::plot_lens,          raysfm::plot_evaluation,
    raysfm::make_photo_features, raysfm::find_board_corners, raysfm::guess_board_size,
    raysfm::plot_boards,
};
