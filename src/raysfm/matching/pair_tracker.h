#pragma once

#include <vector>

#include "raysfm/features/zncc_matcher.h"
#include "raysfm/views/view_archive.h"

namespace raysfm {

template <typename A>
void archive_fields(A& a, ZnccMatch& x) {
  archive(a, x.query, x.train, x.zncc);
}

// Follows the corners of one camera of a view through the views after it, before any geometry is known
// (LBA09 2.1): each is looked for where its own motion, or else that of its neighbours or of the image as a
// whole, leads. A corner that was missed in several views in a row is given up: what would be matched to it
// later is mostly something else.
class PairTracker {
 public:
  PairTracker() = default;  // to be read
  // Follows every `every`-th corner of the base, >= 1: more than one where only their number is asked for.
  PairTracker(ViewPtr base, int camera, int every = 1);

  // Matches the base with the view that follows those seen so far; returns the number of corners matched, by
  // those that are followed.
  int advance(ViewPtr next);

  const CameraView& base() const { return base_->cameras[camera_]; }
  int base_frame() const { return base_->frame; }
  int views() const { return static_cast<int>(matches_.size()); }
  // Feature of the k-th view after the base for each feature of the base, -1 where there is none; empty for a
  // view that was skipped or released.
  const std::vector<int>& matches(int k) const { return matches_[k]; }
  // Passes over a view that is no longer there.
  void skip() { matches_.emplace_back(); }
  // Forgets what was matched with the k-th view.
  void release(int k) { matches_[k] = std::vector<int>(); }
  // Median distance in pixels between the matched features of the base and the newest view.
  float median_displacement() const { return median_displacement_; }

  // The base and the newest view are detected.
  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, base_, newest_, camera_, every_, matches_, place_, velocity_, missed_, foreseen_,
                    found_, median_displacement_);
  }

 private:
  void predict(const CameraView& next, const CoarseMotion* image_motion);
  const PatchSet& patches_for(const CameraView& next);
  void match(const CameraView& next, const CoarseMotion* image_motion, std::vector<ZnccMatch>* found);
  void update(const CameraView& next);

  struct Steps {  // pixels, each coordinate in any order
    std::vector<float> u, v;

    void clear();
    void add(const Eigen::Vector2f& step);
    Eigen::Vector2f median();
  };

  ViewPtr base_, newest_;
  int camera_ = 0, every_ = 1;
  ZnccMatcher matcher_;
  std::vector<std::vector<int>> matches_;
  std::vector<Eigen::Vector2f> place_;     // last known or extrapolated place of each feature
  std::vector<Eigen::Vector2f> velocity_;  // pixels per view
  std::vector<int> missed_;                // views in a row without a match
  std::vector<uint8_t> foreseen_;          // whether it was seen, or enough of its neighbours were
  std::vector<Eigen::Vector2f> predicted_;
  std::vector<float> radius_, radius_in_octave_;
  std::vector<uint8_t> octave_;  // of the next view, in which each feature is looked for
  PatchSet other_patches_;       // of the base, where these are others than those of its features
  std::vector<ZnccMatch> found_, found_by_image_, found_in_octave_;
  std::vector<Steps> steps_of_cell_;  // since the view before, as are these
  Steps all_steps_;
  std::vector<float> displacements_;  // since the base
  float median_displacement_ = 0;
};

// One for each camera of a view, which has its corners.
std::vector<PairTracker> trackers_from(const ViewPtr& base, int every = 1);
// Matches in all cameras.
int advance(std::vector<PairTracker>& trackers, const ViewPtr& next);

}  // namespace raysfm
