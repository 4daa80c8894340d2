#include "raysfm/api/find_lens.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

// A walk through a room, every picture several times.
class RepeatedFilm : public FrameSource {
 public:
  RepeatedFilm(const SynthViews& film, int times) : film_(film), times_(times) {}

  Result<std::optional<InputFrame>> next() override {
    if (next_ == frame_count()) return std::optional<InputFrame>();
    InputFrame frame;
    frame.index = next_;
    frame.timestamp = next_ / 30.0;
    const GrayImage& image = film_.images[next_++ / times_];
    frame.gray = GrayImage(image.width(), image.height());
    for (int y = 0; y < image.height(); ++y) std::copy_n(image.row(y), image.width(), frame.gray.row(y));
    return std::optional(std::move(frame));
  }
  int width() const override { return film_.images[0].width(); }
  int height() const override { return film_.images[0].height(); }
  int frame_count() const override { return times_ * film_.size(); }
  std::string description() const override { return "film"; }

 private:
  const SynthViews& film_;
  int times_, next_ = 0;
};

FoundLens lens_of(const SynthViews& film, int times) {
  Input input;
  input.streams.push_back(std::make_unique<RepeatedFilm>(film, times));
  ZoomedStretch zoom;
  TrackSettings settings;
  settings.inputs = {"film"};
  Result<FoundLens> lens = find_lens(settings, std::move(input), {}, &zoom);
  EXPECT_TRUE(lens) << (lens ? "" : lens.error().message);
  return lens ? *std::move(lens) : FoundLens();
}

// Not from a third of the pictures, nor as if there were three times as many.
TEST(FindLens, AFilmThatRepeatsItsFramesTellsWhatItTellsWithout) {
  const SynthViews film = synth_views("room", "look", 240);
  const FoundLens once = lens_of(film, 1), again = lens_of(film, 3);
  EXPECT_EQ(again.origin.focal, once.origin.focal);
  EXPECT_EQ(again.origin.focal_sigma, once.origin.focal_sigma);
  EXPECT_EQ(again.origin.last_frame, 3 * once.origin.last_frame);
  EXPECT_NEAR(again.origin.focal / small_camera().pixels_per_radian(), 1, 0.02);
}

}  // namespace
}  // namespace raysfm
