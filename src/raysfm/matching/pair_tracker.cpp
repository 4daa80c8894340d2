#include "raysfm/matching/pair_tracker.h"

#include <algorithm>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

constexpr float kMinPairZncc = 0.8f;
// Radius of the region of interest as a part of the image's width: at first, and once the motion is known.
constexpr float kFirstRadius = 0.06f;
constexpr float kRadius = 0.03f;
constexpr float kMinCoarseZncc = 0.6f;
constexpr float kTurnedShare = 0.5f;  // of the matches before: fewer ask for the motion of the whole image
constexpr int kMaxMissed = 2;
constexpr int kColumns = 8, kRows = 6, kCells = kColumns * kRows;  // cells whose matches share a motion
constexpr size_t kEnoughInCell = 5;                                // matches that tell it
// Of the corners of a cell: where fewer are matched, the others may have moved in another way.
constexpr float kForeseenShare = 0.5f;

int cell_of(const Eigen::Vector2f& pixel, float width, float height) {
  const int column = std::clamp(static_cast<int>(pixel.x() / width * kColumns), 0, kColumns - 1);
  const int row = std::clamp(static_cast<int>(pixel.y() / height * kRows), 0, kRows - 1);
  return row * kColumns + column;
}

}  // namespace

void PairTracker::Steps::clear() {
  u.clear();
  v.clear();
}

void PairTracker::Steps::add(const Eigen::Vector2f& step) {
  u.push_back(step.x());
  v.push_back(step.y());
}

Eigen::Vector2f PairTracker::Steps::median() {
  return {median_of(&u), median_of(&v)};
}

PairTracker::PairTracker(ViewPtr base, int camera, int every)
    : base_(std::move(base)), newest_(base_), camera_(camera), every_(every) {
  place_ = this->base().features.pixels;
  const size_t count = place_.size();
  velocity_.assign(count, Eigen::Vector2f::Zero());
  missed_.assign(count, kMaxMissed + 1);
  for (size_t i = 0; i < count; i += every_) missed_[i] = 0;
  foreseen_.assign(count, 0);
}

// Where each corner should be: by its own motion, or by that of the image as a whole.
void PairTracker::predict(const CameraView& next, const CoarseMotion* image_motion) {
  const int width = next.width, height = next.height;
  predicted_.resize(place_.size());
  radius_.resize(place_.size());
  for (size_t i = 0; i < place_.size(); ++i) {
    predicted_[i] = image_motion ? image_motion->apply(place_[i], width, height)
                                 : Eigen::Vector2f(place_[i] + velocity_[i]);
    radius_[i] =
        missed_[i] > kMaxMissed ? 0.0f : (foreseen_[i] ? kRadius : kFirstRadius) * static_cast<float>(width);
  }
}

// Patches of the base in the octaves that the next view has.
const PatchSet& PairTracker::patches_for(const CameraView& next) {
  const Features& features = base().features;
  std::vector<int> others;
  octave_.resize(features.size());
  for (int i = 0; i < features.size(); ++i) {
    octave_[i] = static_cast<uint8_t>(base().octaves->clamp(next.clamp_octave(features.octaves[i])));
    if (octave_[i] != features.octaves[i]) others.push_back(i);
  }
  if (others.empty()) return base().patches;
  other_patches_.resize(features.size());
  for (int i = 0; i < features.size(); ++i) copy_patch(base().patches, i, i, &other_patches_);
  PatchSet patch;
  for (const int i : others) {
    extract_patches(*base().octaves, octave_[i], std::span(&features.pixels[i], 1), &patch);
    copy_patch(patch, 0, i, &other_patches_);
  }
  return other_patches_;
}

void PairTracker::match(const CameraView& next, const CoarseMotion* image_motion,
                        std::vector<ZnccMatch>* found) {
  predict(next, image_motion);
  const PatchSet& patches = patches_for(next);
  found->clear();
  for (int octave = next.first_octave(); octave <= next.last_octave(); ++octave) {
    radius_in_octave_ = radius_;
    for (size_t i = 0; i < octave_.size(); ++i) {
      if (octave_[i] != octave) radius_in_octave_[i] = 0;
    }
    matcher_.match(patches, predicted_, radius_in_octave_, next.patches, next.features.pixels,
                   next.grid(octave), {.min_zncc = kMinPairZncc}, &found_in_octave_);
    found->insert(found->end(), found_in_octave_.begin(), found_in_octave_.end());
  }
}

int PairTracker::advance(ViewPtr next) {
  const size_t expected = views() > 0 ? found_.size() : place_.size() / every_;
  const CameraView& view = next->cameras[camera_];
  match(view, nullptr, &found_);
  // A camera that turns fast leaves every region of interest. Repeating texture can mislead the motion of the
  // whole image, so it must find more than the corners' own motion does.
  if (found_.size() < kTurnedShare * static_cast<float>(expected)) {
    const CoarseMotion motion = coarse_motion(newest_->cameras[camera_], view);
    if (motion.zncc > kMinCoarseZncc) match(view, &motion, &found_by_image_);
    if (found_by_image_.size() > found_.size()) found_.swap(found_by_image_);
    found_by_image_.clear();
  }
  update(view);
  newest_ = std::move(next);
  return every_ * static_cast<int>(found_.size());
}

void PairTracker::update(const CameraView& next) {
  std::vector<int>& matches = matches_.emplace_back(place_.size(), -1);
  for (const ZnccMatch& m : found_) matches[m.query] = m.train;

  // Motion since the view before: the median of the matches of a cell, for those that were not matched.
  const float width = static_cast<float>(next.width), height = static_cast<float>(next.height);
  steps_of_cell_.resize(kCells);
  for (Steps& steps : steps_of_cell_) steps.clear();
  all_steps_.clear();
  displacements_.clear();
  int corners[kCells] = {};
  for (size_t i = 0; i < place_.size(); ++i) {
    if (missed_[i] > kMaxMissed) continue;
    const int cell = cell_of(place_[i], width, height);
    ++corners[cell];
    if (matches[i] < 0) continue;
    const Eigen::Vector2f pixel = next.features.pixels[matches[i]];
    const Eigen::Vector2f step = pixel - place_[i];
    steps_of_cell_[cell].add(step);
    all_steps_.add(step);
    displacements_.push_back((pixel - base().features.pixels[i]).norm());
  }
  const Eigen::Vector2f overall = all_steps_.median();
  Eigen::Vector2f motion[kCells];
  bool foreseen[kCells];
  for (int c = 0; c < kCells; ++c) {
    const size_t matched = steps_of_cell_[c].u.size();
    foreseen[c] = static_cast<float>(matched) >= std::max(static_cast<float>(kEnoughInCell),
                                                          kForeseenShare * static_cast<float>(corners[c]));
    motion[c] = matched >= kEnoughInCell ? steps_of_cell_[c].median() : overall;
  }
  median_displacement_ = median_of(&displacements_);

  for (size_t i = 0; i < place_.size(); ++i) {
    const int cell = cell_of(place_[i], width, height);
    const Eigen::Vector2f neighbours = motion[cell];
    const bool seen = matches[i] >= 0;
    foreseen_[i] = seen || foreseen[cell];
    const Eigen::Vector2f place =
        seen ? next.features.pixels[matches[i]] : Eigen::Vector2f(place_[i] + neighbours);
    velocity_[i] = seen ? Eigen::Vector2f(place - place_[i]) : neighbours;
    missed_[i] = seen ? 0 : missed_[i] + 1;
    place_[i] = place;
  }
}

std::vector<PairTracker> trackers_from(const ViewPtr& base, int every) {
  std::vector<PairTracker> trackers;
  for (int c = 0; c < static_cast<int>(base->cameras.size()); ++c) trackers.emplace_back(base, c, every);
  return trackers;
}

int advance(std::vector<PairTracker>& trackers, const ViewPtr& next) {
  int matches = 0;
  for (PairTracker& tracker : trackers) matches += tracker.advance(next);
  return matches;
}

}  // namespace raysfm
