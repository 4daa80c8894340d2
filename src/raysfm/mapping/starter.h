#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/mapping/localiser.h"
#include "raysfm/mapping/mapper.h"
#include "raysfm/mapping/options.h"
#include "raysfm/matching/pair_tracker.h"
#include "raysfm/robust/fair_start.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A first map, from three views.
struct Start {
  Map map;  // three key frames
  std::vector<KeyFrameView> views;
  StartSummary summary;
  int first_view = 0;  // index into Starter::views() of the first key frame
  // What the views after the first saw of the tracks, before any guidance: corners with a share of outliers.
  // Element k belongs to view first_view + 1 + k.
  std::vector<std::vector<TrackPixel>> seen;
};

// A corner of the first view of an attempt, seen in a later one.
struct SeenCorner {
  int corner = 0;
  uint8_t camera = 0, octave = 0;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
};

// A view that waits for a start. Where too many wait, some are released: coarser images and what the view saw
// of some corners then stand for it, or another view that shows the same.
struct WaitingView {
  int frame = 0;
  ViewPtr view;                  // null once released
  int same_as = -1;              // index of an earlier view, once released as a copy of it
  std::vector<SeenCorner> seen;  // once released otherwise; empty for views before the first
  ViewPtr coarse;                // likewise, its images, without corners; null once these are released too
  int octaves_gone = 0;          // of `coarse`: the finest ones

  const View* images() const { return view ? view.get() : coarse.get(); }
  int coarse_octaves() const;
  // The finest octave goes, or all where it is the only one.
  void coarsen();
};

template <typename A>
void archive_fields(A& a, SeenCorner& x) {
  archive(a, x.corner, x.camera, x.octave, x.pixel);
}
template <typename A>
void archive_fields(A& a, WaitingView& x) {
  archive(a, x.frame, x.view, x.same_as, x.seen, x.coarse, x.octaves_gone);
  if constexpr (A::kReads) {
    if (x.coarse) x.coarse = coarser_images_of(*x.coarse, x.octaves_gone);
  }
}

// Chooses three views and starts a map from them (LBA09 2.2). Feed it the views in order; when the views that
// it chose do not do, it says why and goes on with later ones.
class Starter {
 public:
  Starter(const TrackingRig& rig, const OdometryOptions& options) : rig_(rig), options_(options) {}

  // Every view of the attempt so far, oldest first; those before the first key frame of a start included. The
  // memory of their images is bounded.
  const std::vector<WaitingView>& views() const { return views_; }

  // Takes the next view. A start, or nothing yet.
  std::optional<Start> push(ViewPtr view, Mapper& mapper);
  // No more views will come: tries with what there is.
  std::optional<Start> finish(Mapper& mapper);

  // Why the last attempt failed, and why the one with most matches did; empty before any.
  const std::string& last_reason() const { return last_reason_; }
  const std::string& reason() const { return reason_; }
  // Attempts so far.
  int attempts() const { return attempts_; }
  // Something else moves in much of the image, as far as attempts have seen.
  bool is_crowded() const { return is_crowded_; }

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, views_, tried_at_, first_, second_, next_, from_first_, from_second_, reason_,
                    last_reason_, most_matches_, attempts_, weak_spans_, is_crowded_);
  }

 private:
  bool is_worth_a_try();
  int kept_near(int view) const;
  int sharpest_until(int view, int after) const;
  bool stays_but_in_places(const View& view) const;
  bool blur_changes(const std::array<int, 3>& views) const;
  void release_views();
  void release_coarse();
  void release(int view, int same_as);
  std::optional<Start> step(Mapper& mapper);
  std::optional<Start> attempt_nearer(int end, Mapper& mapper);
  // `ends_span`: later views match less.
  std::optional<Start> attempt(int second, int third, bool ends_span, Mapper& mapper);
  // A corner followed through the three views in one camera, and other cameras that see it in the first.
  struct Match {
    int camera = 0;
    int corner = 0;                  // of the first view
    std::array<TrackPixel, 3> seen;  // tracks not yet numbered
    std::array<Eigen::Vector2f, 3> scan_offsets = {};
    std::vector<AcrossMatch> across;
  };
  std::vector<Match> find_matches(const std::array<int, 3>& views) const;
  struct CornerMotion {
    Eigen::Vector2f pixel, pixels;  // where it is, and how far it moves from the first view to the last
    int first, last;
  };
  std::optional<CornerMotion> corner_motion(int camera, int corner, int view) const;
  Eigen::Vector2f scan_offset(int camera, int corner, int view) const;
  double frame_motion(const std::array<int, 3>& views, const std::vector<Match>& matches) const;
  const Eigen::Vector2f* corner_in(int camera, int corner, int view) const;
  void find_across(const ViewPtr& first, std::vector<Match>* matches);
  static double median_octave_side(const std::vector<Match>& matches);
  int place_in_image(int camera, const Eigen::Vector2f& pixel) const;
  int place_of(const Match& match) const;
  FairStart estimate(const std::vector<Match>& matches, uint64_t stream) const;
  std::optional<Start> build(const std::array<int, 3>& views, const std::vector<Match>& matches,
                             const GenericStart& geometry, Mapper& mapper);
  void collect_seen(const std::vector<Match>& match_of_track, Start* start) const;
  std::vector<SeenCorner> seen_corners(int k, int most) const;
  void add_points(const std::array<int, 3>& views, Start* start, Mapper& mapper);
  void refine_on_surfaces(const std::array<int, 3>& views, Start* start, Mapper& mapper);
  void refine_pixels(const std::array<ViewPtr, 3>& views, Start* start);
  void restart(int first);
  void fail(int matches, std::string reason);
  int enough(int wanted) const;

  const TrackingRig& rig_;
  const OdometryOptions& options_;
  GuidedMatcher matcher_;
  AcrossMatcher across_;
  std::vector<WaitingView> views_;
  float tried_at_ = 0;                                 // displacement at the last try, pixels
  int first_ = 0;                                      // index of I1 in views_
  int second_ = -1;                                    // index of I2, -1 while not chosen
  int next_ = 0;                                       // first view that the trackers have not seen
  std::vector<PairTracker> from_first_, from_second_;  // one for each camera
  std::string reason_, last_reason_;
  int most_matches_ = 0;
  int attempts_ = 0;
  int weak_spans_ = 0;      // that ended with a parallax of little significance
  bool disagreed_ = false;  // in the last attempt no motion explained enough
  bool is_crowded_ = false;
};

}  // namespace raysfm
