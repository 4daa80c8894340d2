#pragma once

#include <functional>
#include <map>
#include <string_view>
#include <utility>

#include "raysfm/core/archive.h"
#include "raysfm/views/view.h"

namespace raysfm {

// The state of what refers to views, without their images: a view depends on its pictures alone, and is made
// again from those of its frame.

// The views that a state refers to, by frame: whether they have their corners.
using ViewsNeeded = std::map<int, bool>;

// Notes the views that it meets.
class StateWriter : public ArchiveWriter {
 public:
  void view(const View& view) { views_[view.frame] |= view.detected(); }
  const ViewsNeeded& views() const { return views_; }

 private:
  ViewsNeeded views_;
};

// Is given the views that the writer noted.
class StateReader : public ArchiveReader {
 public:
  StateReader(std::string_view content, const std::map<int, ViewPtr>& views)
      : ArchiveReader(content), views_(views) {}

  // What becomes of each view that is read from now on.
  void prepare_views(std::function<ViewPtr(const ViewPtr&)> prepare) { prepare_ = std::move(prepare); }

  ViewPtr view(int frame) {
    const auto found = views_.find(frame);
    all_views_ = all_views_ && found != views_.end();
    if (found == views_.end()) return nullptr;
    return prepare_ ? prepare_(found->second) : found->second;
  }
  // No view was missing.
  bool all_views() const { return all_views_; }

 private:
  const std::map<int, ViewPtr>& views_;
  std::function<ViewPtr(const ViewPtr&)> prepare_;
  bool all_views_ = true;
};

template <typename A>
void archive_value(A& a, ViewPtr& view) {
  constexpr int kNone = -1;
  int frame = view ? view->frame : kNone;
  archive(a, frame);
  if constexpr (A::kReads) {
    view = frame == kNone ? nullptr : a.view(frame);
  } else if (view) {
    a.view(*view);
  }
}

template <typename A>
void archive_fields(A& a, PatchSet& x) {
  size_t count = x.size();
  a.count(&count, kPatchStride);
  if constexpr (A::kReads) x.resize(static_cast<int>(count));
  for (int i = 0; i < static_cast<int>(count); ++i) {
    float inverse_norm = x.inverse_norm(i);
    a.bytes(x.mutable_patch(i), kPatchStride);
    archive(a, inverse_norm);
    if constexpr (A::kReads) x.set_inverse_norm(i, inverse_norm);
  }
}

template <typename A>
void archive_fields(A& a, KeyFrameView& x) {
  archive(a, x.view, x.cameras, x.pixels, x.octaves, x.patches, x.origins, x.directions, x.point_jacobians);
  if constexpr (A::kReads) {
    if (x.view) x.view = images_of(*x.view);
  }
}

}  // namespace raysfm
