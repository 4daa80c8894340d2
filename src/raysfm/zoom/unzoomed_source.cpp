#include "raysfm/zoom/unzoomed_source.h"

#include <string>
#include <utility>

namespace raysfm {
namespace {

class UnzoomedSource final : public FrameSource {
 public:
  UnzoomedSource(std::unique_ptr<FrameSource> source, UndoneZoom zoom)
      : source_(std::move(source)), zoom_(std::move(zoom)) {}

  Result<std::optional<InputFrame>> next() override {
    Result<std::optional<InputFrame>> frame = source_->next();
    const size_t number = next_++;
    if (!frame || !*frame || (*frame)->gray.empty()) return frame;
    const CanvasPlace place = zoom_.place(number);
    (*frame)->colors = on_canvas((*frame)->colors, (*frame)->gray, place);
    (*frame)->gray = on_canvas((*frame)->gray, place);
    return frame;
  }

  int width() const override { return zoom_.width; }
  int height() const override { return zoom_.height; }
  double pixel_aspect() const override { return source_->pixel_aspect(); }
  int frame_count() const override { return source_->frame_count(); }
  TimeRange span() const override { return source_->span(); }
  Result<void> cut(const TimeRange& range) override { return source_->cut(range); }
  std::string description() const override { return source_->description(); }
  std::string note() const override { return source_->note(); }

 private:
  std::unique_ptr<FrameSource> source_;
  UndoneZoom zoom_;
  size_t next_ = 0;  // frame
};

}  // namespace

std::unique_ptr<FrameSource> unzoomed(std::unique_ptr<FrameSource> source, UndoneZoom zoom) {
  return std::make_unique<UnzoomedSource>(std::move(source), std::move(zoom));
}

}  // namespace raysfm
