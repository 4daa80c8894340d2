#include "raysfm/views/fixed_marks.h"

#include <algorithm>
#include <iterator>
#include <span>

namespace raysfm {
namespace {

// Square cells across an image, of which those with a few corners count.
constexpr int kCellsAcross = 16, kCornersInCell = 2, kLeastCells = 6;
// Part of the cells that must have moved for a step, and of a cell's corners that may be found again in one
// that did.
constexpr double kMovedCells = 0.5, kStillInCell = 0.25;
// Pixels of the octave, and correlation: of a corner that may only have trembled, and of one that is the same
// at the same place. Far points ahead of a car move little, but they tremble with it by more than that.
constexpr float kTremble = 3, kAlike = 0.8f, kSamePlace = 0.3f, kSame = 0.9f;
// Steps of a round, and the part of them in which a mark was found, and in which one was that is at most so
// many times its reach from such: compression changes some of what is laid over a film more than the rest.
constexpr int kRoundSteps = 16;
constexpr double kFound = 0.75, kFoundNear = 0.4;
constexpr float kNear = 3;
constexpr int kBeforeDoubt = 3;  // steps
constexpr int kMostInCell = 4;   // corners that tell whether it moved
// Fewer are chance.
constexpr size_t kLeastMarks = 5;
// Part of the image: what stays is rather the scene of a camera that stands.
constexpr double kMostMarked = 0.4;
// Of a mark, part of the image's longer side: between the letters of a text, and patches that reach into it.
constexpr float kReach = 0.025f;

// Whether a corner at a place shows a patch.
bool shows(const CameraView& view, const Eigen::Vector2f& pixel, int octave, const PatchSet& patches, int i,
           float distance, float alike) {
  if (octave < view.first_octave() || octave > view.last_octave()) return false;
  bool found = false;
  view.grid(octave).for_each_in(pixel, distance * octave_side(octave),
                                [&](int f) { found = found || zncc(patches, i, view.patches, f) >= alike; });
  return found;
}

template <typename T>
std::vector<T> some_of(const std::vector<T>& values, const std::vector<int>& which) {
  std::vector<T> some;
  some.reserve(which.size());
  for (const int i : which) some.push_back(values[i]);
  return some;
}

PatchSet some_of(const PatchSet& patches, const std::vector<int>& which) {
  PatchSet some;
  some.resize(static_cast<int>(which.size()));
  for (size_t k = 0; k < which.size(); ++k) copy_patch(patches, which[k], static_cast<int>(k), &some);
  return some;
}

Features some_of(const Features& features, const std::vector<int>& which) {
  return {some_of(features.pixels, which), some_of(features.scores, which), some_of(features.octaves, which)};
}

// An image with some of its corners.
CameraView with_corners(const CameraView& view, const std::vector<int>& which) {
  CameraView some;
  some.CameraImage::operator=(view);
  some.features = some_of(view.features, which);
  some.patches = some_of(view.patches, which);
  some.rgb = some_of(view.rgb, which);
  for (int o = view.first_octave(); o <= view.last_octave(); ++o) {
    const auto& octaves = some.features.octaves;
    const auto [begin, end] = std::equal_range(octaves.begin(), octaves.end(), static_cast<uint8_t>(o));
    some.grids.emplace_back().build(some.features.pixels, static_cast<int>(begin - octaves.begin()),
                                    static_cast<int>(end - octaves.begin()), view.width, view.height, o);
  }
  return some;
}

// The square cells of an image: many corners in one place count no more than few in another.
class CellGrid {
 public:
  CellGrid(int width, int height)
      : side_(static_cast<float>(width) / kCellsAcross),
        count_(size_t{kCellsAcross} * (static_cast<int>(static_cast<float>(height) / side_) + 1)) {}

  size_t count() const { return count_; }
  size_t at(const Eigen::Vector2f& pixel) const {
    const auto column = std::clamp(static_cast<int>(pixel.x() / side_), 0, kCellsAcross - 1);
    const auto row = static_cast<size_t>(std::max(0.0f, pixel.y()) / side_);
    return std::min(row * kCellsAcross + column, count_ - 1);
  }

 private:
  float side_;  // pixels
  size_t count_;
};

// What of the corners of each cell was found again.
class MovedCells {
 public:
  explicit MovedCells(const CellGrid& cells) : cells_(cells), of_cell_(cells.count()) {}

  void add(const Eigen::Vector2f& pixel, bool found) {
    OfCell& cell = of_cell_[cells_.at(pixel)];
    ++cell.corners;
    cell.found += found;
  }
  bool most_moved() const {
    const auto counts = [](const OfCell& c) { return c.corners >= kCornersInCell; };
    const auto moved = [&](const OfCell& c) { return counts(c) && c.found <= kStillInCell * c.corners; };
    const auto all = std::ranges::count_if(of_cell_, counts);
    return all >= kLeastCells && std::ranges::count_if(of_cell_, moved) >= kMovedCells * double(all);
  }

 private:
  struct OfCell {
    int corners = 0, found = 0;
  };
  CellGrid cells_;
  std::vector<OfCell> of_cell_;
};

}  // namespace

std::vector<int> FixedMarks::unmarked(const CameraView& view, int camera) const {
  std::vector<int> which;
  for (int f = 0; f < view.features.size(); ++f) {
    if (!covers(camera, view.features.pixels[f])) which.push_back(f);
  }
  return which;
}

// Some of each cell, others at another time. Where something has stayed for some steps, that has no say in
// whether the rest has moved: a bonnet may have most of the corners.
void FixedMarks::take_base(const View& view, int c, Watched* camera) const {
  const CameraView& seen = view.cameras[c];
  const CellGrid cells(seen.width, seen.height);
  std::vector<int> all = unmarked(seen, c), in_cell(cells.count()), which;
  constexpr ptrdiff_t kStride = 37;  // corners are in the order of their octaves and places
  if (is_in_doubt()) {
    for (const Suspect& s : camera->suspects) {
      if (is_strong(s)) in_cell[cells.at(s.pixel)] = kMostInCell;
    }
  }
  if (!all.empty()) std::rotate(all.begin(), all.begin() + view.frame * kStride % std::ssize(all), all.end());
  for (const int f : all) {
    if (++in_cell[cells.at(seen.features.pixels[f])] <= kMostInCell) which.push_back(f);
  }
  camera->base = some_of(seen.features, which);
  camera->base_patches = some_of(seen.patches, which);
}

void FixedMarks::begin_round(const View& view) {
  cameras_.resize(view.cameras.size());
  steps_ = 0;
  for (int c = 0; c < static_cast<int>(cameras_.size()); ++c) {
    const CameraView& seen = view.cameras[c];
    take_base(view, c, &cameras_[c]);
    const std::vector<int> which = unmarked(seen, c);
    cameras_[c].suspects.clear();
    for (const int f : which)
      cameras_[c].suspects.push_back({seen.features.pixels[f], seen.features.octaves[f]});
    cameras_[c].patches = some_of(seen.patches, which);
  }
}

// Every camera of a rig sees another part of the world.
bool FixedMarks::has_moved(const View& view) const {
  for (size_t c = 0; c < cameras_.size(); ++c) {
    const CameraView& seen = view.cameras[c];
    const Watched& camera = cameras_[c];
    const CellGrid cells(seen.width, seen.height);
    MovedCells moved(cells);
    for (int i = 0; i < camera.base.size(); ++i) {
      const Eigen::Vector2f& pixel = camera.base.pixels[i];
      moved.add(pixel, shows(seen, pixel, camera.base.octaves[i], camera.base_patches, i, kTremble, kAlike));
    }
    if (!moved.most_moved()) return false;
  }
  return true;
}

// It may still be a mark by itself.
bool FixedMarks::is_strong(const Suspect& suspect) const {
  return suspect.found >= kFound * steps_ - 1;
}

// What may still be a mark after one more step.
void FixedMarks::keep_unmoved(const CameraView& view, Watched* camera) const {
  std::vector<int> which;
  for (int i = 0; i < static_cast<int>(camera->suspects.size()); ++i) {
    Suspect& s = camera->suspects[i];
    s.found += shows(view, s.pixel, s.octave, camera->patches, i, kSamePlace, kSame);
    if (s.found >= kFoundNear * steps_ - 1) which.push_back(i);
  }
  if (which.size() == camera->suspects.size()) return;
  camera->suspects = some_of(camera->suspects, which);
  camera->patches = some_of(camera->patches, which);
}

bool FixedMarks::watch(const View& view) {
  if (view.frame <= newest_) return false;
  newest_ = view.frame;
  if (cameras_.empty()) {
    begin_round(view);
    return false;
  }
  if (!has_moved(view)) return false;
  ++steps_;
  size_t suspects = 0;
  for (size_t c = 0; c < cameras_.size(); ++c) {
    keep_unmoved(view.cameras[c], &cameras_[c]);
    take_base(view, static_cast<int>(c), &cameras_[c]);
    suspects += std::ranges::count_if(cameras_[c].suspects, [&](const Suspect& s) { return is_strong(s); });
  }
  if (suspects < kLeastMarks) {
    begin_round(view);
    return false;
  }
  return steps_ >= kRoundSteps && end_round(view);
}

// Where that much of the image stays in its place, it is the camera that stands, and others move.
bool FixedMarks::end_round(const View& view) {
  const std::vector<Mark> before = marks_;
  for (int c = 0; c < static_cast<int>(cameras_.size()); ++c) {
    const float reach = kReach * static_cast<float>(view.cameras[c].longer_side());
    const auto is_within = [&](float distance, std::span<const Mark> marks, const Eigen::Vector2f& pixel) {
      return std::ranges::any_of(
          marks, [&](const Mark& m) { return m.camera == c && (m.pixel - pixel).norm() < distance; });
    };
    const auto add = [&](const Eigen::Vector2f& pixel) {
      if (!is_within(0.5f * reach, marks_, pixel))
        marks_.push_back({pixel, static_cast<uint8_t>(c), reach, view.frame});
    };
    for (const Suspect& s : cameras_[c].suspects) {
      if (s.found >= kFound * kRoundSteps) add(s.pixel);
    }
    const std::vector<Mark> sure = marks_;
    for (const Suspect& s : cameras_[c].suspects) {
      if (s.found >= kFoundNear * kRoundSteps && is_within(kNear * reach, sure, s.pixel)) add(s.pixel);
    }
  }
  if (part_of(view) > kMostMarked) marks_ = before;
  begin_round(view);
  return marks_.size() > before.size();
}

bool FixedMarks::is_in_doubt() const {
  return steps_ >= kBeforeDoubt;
}

void FixedMarks::hold_from(int frame) {
  for (Mark& mark : marks_) mark.since = std::min(mark.since, frame);
}

bool FixedMarks::covers(int camera, const Eigen::Vector2f& pixel) const {
  return std::ranges::any_of(marks_, [&](const Mark& m) { return m.covers(camera, pixel); });
}

ViewPtr FixedMarks::without(const ViewPtr& view) const {
  const auto holds = [&](const Mark& m) { return m.since <= view->frame; };
  if (!view->detected() || std::ranges::none_of(marks_, holds)) return view;
  auto rest = std::make_shared<View>(view->stamp());
  rest->evenly = view->evenly;
  for (int c = 0; c < static_cast<int>(view->cameras.size()); ++c) {
    const Features& features = view->cameras[c].features;
    std::vector<int> which;
    for (int f = 0; f < features.size(); ++f) {
      const auto covers = [&](const Mark& m) { return holds(m) && m.covers(c, features.pixels[f]); };
      if (std::ranges::none_of(marks_, covers)) which.push_back(f);
    }
    rest->cameras.push_back(with_corners(view->cameras[c], which));
  }
  return rest;
}

double FixedMarks::part_of(const View& view) const {
  constexpr int kAcross = 64;  // places that are asked
  int covered = 0, all = 0;
  for (int c = 0; c < static_cast<int>(view.cameras.size()); ++c) {
    const float step = static_cast<float>(view.cameras[c].width) / kAcross;
    for (float y = 0.5f * step; y < static_cast<float>(view.cameras[c].height); y += step) {
      for (float x = 0.5f * step; x < static_cast<float>(view.cameras[c].width); x += step, ++all) {
        covered += covers(c, {x, y});
      }
    }
  }
  return all > 0 ? static_cast<double>(covered) / all : 0;
}

}  // namespace raysfm
