#include "raysfm/mapping/starter.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "raysfm/core/median.h"
#include "raysfm/views/scan_correction.h"
#include "raysfm/views/surfaces.h"

namespace raysfm {
namespace {

constexpr double kStartCornerError = 2.0;  // pixels of the octave
constexpr int kMinStartInliers = 50;
// Right starts on real footage explain 0.6 to 0.95 of the matches, wrong ones of turning cameras under 0.5.
constexpr double kMinInlierRatio = 0.55;
// Median parallax over the rms error of the rays. Blur and a rolling shutter bend the rays of a turning
// camera into a parallax of up to 20 times their error; starts with translation have 30 and more.
constexpr double kMinSignificance = 28;
// Small or noisy images may never have as much. What blur and a rolling shutter feign is no more than the
// image moves from one frame to the next: a parallax of more times that is believed with less significance,
// where so many spans of views before had no more.
constexpr double kLeastSignificance = 10, kBeyondFrameMotion = 1.5;
constexpr int kWeakSpans = 5;
// The places of the image that count alike, along its longer side.
constexpr int kPlacesAcross = 12, kPlaces = kPlacesAcross * kPlacesAcross;
// Of the image: another motion that explains more says that much moves in it.
constexpr double kCrowdedShare = 0.15;
// Spans that are tried where no motion explains enough of the longest one, and frames of the shortest.
constexpr int kNearerSpans = 2, kShortestSpan = 4;
constexpr float kMinFeatureShare = 0.3f;  // M as a part of the corners, where there are few

// Views after which a rig that moves slowly tries to start before its matches become few, and between tries;
// and how far, as a part of the image's longer side, corners must have moved for a single camera, and how
// much farther for another try.
constexpr int kPatience = 15, kBetweenTries = 5;
// Of the corners that are followed: more stay within so many pixels of their octave; and of the places with
// such corners, in more of them most have moved far.
constexpr float kStays = 1;
constexpr double kMostStays = 0.5, kSomePlaces = 0.1;
constexpr float kMotionForTry = 0.03f, kFartherForTry = 1.25f;
constexpr size_t kNewViews = 8;     // of those that wait: they are never released
constexpr size_t kCoarseShare = 4;  // of what they may take, which coarser images may take beside
constexpr int kSampled = 3;  // corners of the second view, of which only the matches' number is asked for
constexpr int kSeenCorners = 400;  // that stand for a released view, of each camera
constexpr float kStill = 0.3f,
                kAlike = 0.99f;  // pixels of the octave, and correlation, of views that are copies
// An image this much softer than one just before it is no good for a key frame.
constexpr float kMuchSofter = 1.25f;
// Of Octaves::motion_blur() between the views of a start, pixels of the octave. Starts at the end of turns of
// 200 degrees a second come out right from 0.5 to 0.8; at 1.2 some maps are off by a tenth.
constexpr float kMostBlurChange = 0.8f;

// Whether nothing has moved between two views, as far as their thumbnails tell.
bool show_the_same(const View& a, const View& b) {
  for (size_t c = 0; c < a.cameras.size(); ++c) {
    const CoarseMotion motion = coarse_motion(a.cameras[c], b.cameras[c]);
    const float still = kStill * octave_side(b.cameras[c].first_octave());
    const float turned = 0.5f * static_cast<float>(b.cameras[c].width) * std::abs(motion.angle);
    if (motion.zncc < kAlike || motion.shift.norm() > still || turned > still) return false;
  }
  return true;
}

const char* name_of(GenericStartMethod method) {
  switch (method) {
    case GenericStartMethod::kAuto:
      break;
    case GenericStartMethod::kCentral:
      return "five-point";
    case GenericStartMethod::kStereoPoints:
      return "stereo-points";
    case GenericStartMethod::kFivePoints:
      return "five-point-rig";
    case GenericStartMethod::kSeventeenPoint:
      return "pless";
  }
  return "auto";
}

}  // namespace

// Of many attempts the one with most matches says most about why none succeeded.
void Starter::fail(int matches, std::string reason) {
  last_reason_ = std::move(reason);
  if (matches < most_matches_) return;
  most_matches_ = matches;
  reason_ = last_reason_;
}

// M and M' of the paper stand for 1500 corners; images with fewer ask for less.
int Starter::enough(int wanted) const {
  int corners = 0;
  for (const PairTracker& tracker : from_first_) corners += tracker.base().features.size();
  return std::max(kMinStartInliers,
                  std::min(wanted, static_cast<int>(kMinFeatureShare * corners * wanted / 400)));
}

void Starter::restart(int first) {
  first_ = first;
  second_ = -1;
  next_ = first + 1;
  tried_at_ = 0;
  from_first_ = trackers_from(views_[first].view);
  from_second_.clear();
}

std::optional<Start> Starter::push(ViewPtr view, Mapper& mapper) {
  views_.emplace_back().frame = view->frame;
  views_.back().view = view;
  if (views_.size() == 1) restart(0);
  while (next_ < static_cast<int>(views_.size())) {
    if (auto start = step(mapper)) return start;
  }
  release_views();
  return std::nullopt;
}

// Where matches stay for long: a rig's cameras see to all sides, a single one moves slowly.
bool Starter::is_worth_a_try() {
  if (rig_.size() > 1) return true;
  const float moved = from_first_[0].median_displacement();
  const float wanted = kMotionForTry * static_cast<float>(rig_.camera(0).longer_side());
  if (moved < std::max(wanted, kFartherForTry * tried_at_)) return false;
  tried_at_ = moved;
  return true;
}

// Whether a camera sees most corners stay where they were, and only such that moved far in some parts of its
// image: of the rest a bonnet or a picture laid over the film has the stronger corners, or the camera stands
// and others pass.
bool Starter::stays_but_in_places(const View& view) const {
  for (size_t c = 0; c < from_first_.size(); ++c) {
    const PairTracker& tracker = from_first_[c];
    const std::vector<int>& matches = tracker.matches(tracker.views() - 1);
    const float far = kMotionForTry * static_cast<float>(rig_.camera(static_cast<int>(c)).longer_side());
    std::array<int, kPlaces> followed = {}, moved = {};
    int all = 0, still = 0;
    for (size_t f = 0; f < matches.size(); ++f) {
      if (matches[f] < 0) continue;
      const Eigen::Vector2f& before = tracker.base().features.pixels[f];
      const float distance = (view.cameras[c].features.pixels[matches[f]] - before).norm();
      const int place = place_in_image(static_cast<int>(c), before);
      ++all;
      ++followed[place];
      still += distance < kStays * octave_side(tracker.base().features.octaves[f]);
      moved[place] += distance > far;
    }
    int places = 0, moved_places = 0;
    for (size_t k = 0; k < followed.size(); ++k) {
      places += followed[k] > 0;
      moved_places += 2 * moved[k] > followed[k];
    }
    if (still > kMostStays * all && moved_places > kSomePlaces * places) return true;
  }
  return false;
}

// Whether motion draws out the images of a camera farther in one of the views than in another. The ends of
// streaks then move against each other as corners of a world would.
bool Starter::blur_changes(const std::array<int, 3>& views) const {
  for (int c = 0; c < rig_.size(); ++c) {
    float least = std::numeric_limits<float>::infinity(), most = 0, side = 1;
    for (const int v : views) {
      const Octaves& octaves = *views_[v].view->cameras[c].octaves;
      least = std::min(least, octaves.motion_blur());
      most = std::max(most, octaves.motion_blur());
      side = std::max(side, octave_side(octaves.first()));
    }
    if (most - least > kMostBlurChange * side) return true;
  }
  return false;
}

// The view nearest to one of the attempt whose images are there, between the first and the last.
int Starter::kept_near(int view) const {
  const int last = static_cast<int>(views_.size()) - 1;
  for (int step = 0; step < last; ++step) {
    if (view - step > first_ && views_[view - step].view) return view - step;
    if (view + step < last && views_[view + step].view) return view + step;
  }
  return view;
}

// `view`, or one of the two before it where that is blurred; later than `after`.
int Starter::sharpest_until(int view, int after) const {
  const auto softness = [&](int v) {
    const Octaves& octaves = *views_[v].view->cameras[0].octaves;
    return octaves.softness() * octave_side(octaves.first());
  };
  int best = view;
  for (int v = view - 1; v > std::max(after, view - 3) && views_[v].view; --v) {
    if (kMuchSofter * softness(v) < softness(best)) best = v;
  }
  return best;
}

// At most so many in each camera, evenly over the corners of the first view.
std::vector<SeenCorner> Starter::seen_corners(int k, int most) const {
  std::vector<SeenCorner> seen;
  for (int c = 0; c < rig_.size(); ++c) {
    const std::vector<int>& matches = from_first_[c].matches(k);
    const Features& features = views_[first_ + 1 + k].view->cameras[c].features;
    const auto count = std::ranges::count_if(matches, [](int m) { return m >= 0; });
    int64_t share = 0;
    for (size_t f = 0; f < matches.size(); ++f) {
      if (matches[f] < 0) continue;
      share += std::min<int64_t>(most, count);
      if (share < count) continue;
      share -= count;
      seen.push_back({static_cast<int>(f), static_cast<uint8_t>(c), features.octaves[matches[f]],
                      features.pixels[matches[f]]});
    }
  }
  return seen;
}

void Starter::release(int view, int same_as) {
  const int k = view - first_ - 1;
  views_[view].same_as = same_as;
  if (same_as < 0 && k >= 0) views_[view].seen = seen_corners(k, kSeenCorners);
  if (k >= 0) {
    for (PairTracker& tracker : from_first_) tracker.release(k);
  }
  if (same_as < 0) {
    views_[view].coarse = views_[view].view;
    views_[view].coarsen();
  }
  views_[view].view.reset();
}

int WaitingView::coarse_octaves() const {
  int most = 0;
  for (size_t c = 0; coarse && c < coarse->cameras.size(); ++c) {
    const Octaves& octaves = *coarse->cameras[c].octaves;
    most = std::max(most, octaves.last() - octaves.first() + 1);
  }
  return most;
}

void WaitingView::coarsen() {
  coarse = coarse_octaves() > 1 ? coarser_images_of(*coarse, 1) : nullptr;
  ++octaves_gone;
}

// The oldest of those with most octaves become coarser.
void Starter::release_coarse() {
  const size_t most_bytes = options_.waiting_bytes / kCoarseShare;
  size_t bytes = 0;
  int most_octaves = 0;
  for (const WaitingView& v : views_) {
    bytes += v.coarse ? bytes_of(*v.coarse) : 0;
    most_octaves = std::max(most_octaves, v.coarse_octaves());
  }
  for (int octaves = most_octaves; octaves > 0; --octaves) {
    for (auto v = views_.begin(); v != views_.end() && bytes > most_bytes; ++v) {
      if (v->coarse_octaves() < octaves) continue;
      bytes -= bytes_of(*v->coarse);
      v->coarsen();
      bytes += v->coarse ? bytes_of(*v->coarse) : 0;
    }
  }
}

// Copies go first, then every second of the rest; never the newest, nor those that a start would be made of.
void Starter::release_views() {
  std::vector<int> kept;
  size_t bytes = 0;
  for (int v = 0; v < next_; ++v) {
    if (!views_[v].view) continue;
    kept.push_back(v);
    bytes += bytes_of(*views_[v].view);
  }
  if (bytes <= options_.waiting_bytes) return;
  size_t rest = std::min<size_t>(1, kept.size());
  for (size_t i = 1; i < kept.size(); ++i) {
    const int v = kept[i], before = kept[rest - 1];
    const bool needed = v == first_ || v == second_ || i + kNewViews >= kept.size();
    if (!needed && show_the_same(*views_[before].view, *views_[v].view)) {
      bytes -= bytes_of(*views_[v].view);
      release(v, before);
    } else {
      kept[rest++] = v;
    }
  }
  kept.resize(rest);
  for (size_t i = 1; bytes > options_.waiting_bytes && i + kNewViews < kept.size(); i += 2) {
    if (kept[i] != first_ && kept[i] != second_) release(kept[i], -1);
  }
  release_coarse();
}

std::optional<Start> Starter::step(Mapper& mapper) {
  const int current = next_++;
  const ViewPtr view = views_[current].view;
  if (!view) {
    for (PairTracker& tracker : from_first_) tracker.skip();
    return std::nullopt;
  }
  const int with_first = advance(from_first_, view);
  if (second_ < 0) {
    const int waited = current - first_;
    const bool is_time = waited >= kPatience && waited % kBetweenTries == 0;
    is_crowded_ = is_crowded_ || (is_time && stays_but_in_places(*view));
    if (with_first >= enough(options_.min_matches))
      return is_time && is_worth_a_try() ? attempt(kept_near((first_ + current) / 2), current, false, mapper)
                                         : std::nullopt;
    second_ = kept_near(sharpest_until(std::max(current - 1, first_ + 1), first_));
    from_second_ = trackers_from(views_[second_].view, kSampled);
    if (second_ == current) return std::nullopt;
  }
  const int with_second = advance(from_second_, view);
  if (with_second >= enough(options_.min_matches) && with_first >= enough(options_.min_matches3))
    return std::nullopt;

  const int third = sharpest_until(std::max(current - 1, second_ + 1), second_);
  if (third > current || !views_[third].view) return std::nullopt;
  auto start = attempt(second_, third, true, mapper);
  if (!start && disagreed_) start = attempt_nearer(second_, mapper);
  if (!start) restart(second_);
  return start;
}

// What stands still goes out of sight before what moves along: shorter and shorter spans, which see more of
// it.
std::optional<Start> Starter::attempt_nearer(int end, Mapper& mapper) {
  for (int k = 0; k < kNearerSpans && end - first_ >= kShortestSpan; ++k) {
    const int middle = kept_near((first_ + end) / 2);
    const bool all_kept = std::all_of(views_.begin() + end, views_.end(),
                                      [](const WaitingView& v) { return v.view != nullptr; });
    if (!all_kept || middle >= end) break;
    if (auto start = attempt(middle, end, false, mapper); start || !disagreed_) return start;
    end = middle;
  }
  return std::nullopt;
}

std::optional<Start> Starter::finish(Mapper& mapper) {
  const int last = static_cast<int>(views_.size()) - 1;
  if (last - first_ < 2) {
    if (reason_.empty()) reason_ = fmt::format("{} frames are too few, at least 3 are needed", views_.size());
    return std::nullopt;
  }
  const int second = second_ > first_ && second_ < last ? second_ : kept_near((first_ + last) / 2);
  weak_spans_ = kWeakSpans;
  return attempt(second, last, true, mapper);
}

std::vector<Starter::Match> Starter::find_matches(const std::array<int, 3>& views) const {
  std::vector<Match> matches;
  for (int c = 0; c < rig_.size(); ++c) {
    const std::vector<int>& second = from_first_[c].matches(views[1] - first_ - 1);
    const std::vector<int>& third = from_first_[c].matches(views[2] - first_ - 1);
    for (int f = 0; f < from_first_[c].base().features.size(); ++f) {
      if (second[f] < 0 || third[f] < 0) continue;
      const int features[3] = {f, second[f], third[f]};
      Match match{c, f, {}, {}, {}};
      for (int v = 0; v < 3; ++v) {
        const Features& of_view = views_[views[v]].view->cameras[c].features;
        match.seen[v] = {-1, static_cast<uint8_t>(c), of_view.octaves[features[v]],
                         of_view.pixels[features[v]]};
      }
      for (int v = 0; v < 3 && rig_.scans(); ++v) match.scan_offsets[v] = scan_offset(c, f, views[v]);
      matches.push_back(std::move(match));
    }
  }
  return matches;
}

// Where a view shows a corner of the first one; null where it was not followed or is not there any more.
const Eigen::Vector2f* Starter::corner_in(int camera, int corner, int view) const {
  if (view < first_ || view >= next_ || !views_[view].view) return nullptr;
  const int feature = view == first_ ? corner : from_first_[camera].matches(view - first_ - 1)[corner];
  return feature < 0 ? nullptr : &views_[view].view->cameras[camera].features.pixels[feature];
}

// From the view before to the one after, without any geometry; none where it is seen in neither.
std::optional<Starter::CornerMotion> Starter::corner_motion(int camera, int corner, int view) const {
  const Eigen::Vector2f* here = corner_in(camera, corner, view);
  const Eigen::Vector2f* before = corner_in(camera, corner, view - 1);
  const Eigen::Vector2f* after = corner_in(camera, corner, view + 1);
  if (!here || (!before && !after)) return std::nullopt;
  return CornerMotion{*here, (after ? *after : *here) - (before ? *before : *here), before ? view - 1 : view,
                      after ? view + 1 : view};
}

// How far a corner is seen from where it would be, had the whole image been exposed at once.
Eigen::Vector2f Starter::scan_offset(int camera, int corner, int view) const {
  const std::optional<CornerMotion> motion = corner_motion(camera, corner, view);
  if (!motion) return Eigen::Vector2f::Zero();
  const double seconds = views_[motion->last].view->timestamp - views_[motion->first].view->timestamp;
  const double exposed_after = rig_.camera(camera).exposed_after(motion->pixel.cast<double>());
  return motion->pixels * static_cast<float>(exposed_after / seconds);
}

// What corners move in the images from one frame to the next, radians: in the median, at the view where that
// is most. Infinite where none is seen in two frames that follow each other.
double Starter::frame_motion(const std::array<int, 3>& views, const std::vector<Match>& matches) const {
  double most = 0;
  for (const int v : views) {
    std::vector<float> moved;
    for (const Match& m : matches) {
      if (const auto motion = corner_motion(m.camera, m.corner, v))
        moved.push_back(motion->pixels.norm() / static_cast<float>(motion->last - motion->first));
    }
    if (moved.empty()) return std::numeric_limits<double>::infinity();
    most = std::max<double>(most, median_of(&moved));
  }
  return most / rig_.pixels_per_radian();
}

void Starter::find_across(const ViewPtr& first, std::vector<Match>* matches) {
  if (rig_.common_views().empty()) return;
  MapKeyFrame features;
  std::vector<int> all;
  for (const Match& m : *matches)
    all.push_back(features.add(m.camera, m.seen[0].pixel, m.seen[0].octave, -1));
  std::vector<AcrossMatch> across;
  across_.match(rig_, make_keyframe_view(first, features, rig_), *first, all, &across);
  for (const AcrossMatch& m : across) (*matches)[m.feature].across.push_back(m);
}

// Pixels that a pixel of the octaves stands for, in the median.
double Starter::median_octave_side(const std::vector<Match>& matches) {
  std::vector<float> sides;
  for (const Match& m : matches) {
    for (const TrackPixel& seen : m.seen) sides.push_back(octave_side(seen.octave));
  }
  return median_of(&sides);
}

// The part of a camera's image that a pixel lies in.
int Starter::place_in_image(int camera, const Eigen::Vector2f& pixel) const {
  const float side = static_cast<float>(rig_.camera(camera).longer_side()) / kPlacesAcross;
  const auto along = [&](float at) { return std::clamp(static_cast<int>(at / side), 0, kPlacesAcross - 1); };
  return along(pixel.y()) * kPlacesAcross + along(pixel.x());
}

// That a match begins in, of the images of all cameras.
int Starter::place_of(const Match& match) const {
  return match.camera * kPlaces + place_in_image(match.camera, match.seen[0].pixel);
}

FairStart Starter::estimate(const std::vector<Match>& matches, uint64_t stream) const {
  std::vector<ObservedRay> rays;
  std::vector<int> points, views, cameras, places;
  const auto add = [&](int point, int view, int camera, const Eigen::Vector2f& pixel, int octave) {
    ObservedRay ray;
    if (!rig_.observe(camera, pixel, &ray)) return;
    ray.tangents /= octave_side(octave);
    rays.push_back(ray);
    points.push_back(point);
    views.push_back(view);
    cameras.push_back(camera);
  };
  for (size_t i = 0; i < matches.size(); ++i) {
    const int point = static_cast<int>(i);
    places.push_back(place_of(matches[i]));
    for (int v = 0; v < 3; ++v)
      add(point, v, matches[i].camera, matches[i].seen[v].pixel - matches[i].scan_offsets[v],
          matches[i].seen[v].octave);
    for (const AcrossMatch& m : matches[i].across) add(point, 0, m.camera, m.pixel, m.octave);
  }
  GenericStartOptions options;
  options.method = options_.start;
  options.max_error = kStartCornerError;
  options.min_inliers = kMinStartInliers;
  options.min_inlier_ratio = kMinInlierRatio;
  options.seed = options_.seed;
  options.stream = stream;
  return start_fairly({static_cast<int>(matches.size()), rays, points, views, cameras}, places, options);
}

std::optional<Start> Starter::attempt(int second, int third, bool ends_span, Mapper& mapper) {
  ++attempts_;
  const std::array<int, 3> views = {first_, second, third};
  std::vector<Match> matches = find_matches(views);
  find_across(views_[first_].view, &matches);
  const FairStart fair = estimate(matches, views_[first_].view->random_stream());
  const GenericStart& geometry = fair.start;
  disagreed_ =
      geometry.problem == StartProblem::kTooFewInliers || geometry.problem == StartProblem::kTwoMotions;
  is_crowded_ = is_crowded_ || fair.rival_share > kCrowdedShare;
  const std::string frames =
      fmt::format("frames {}, {}, {}", views_[first_].frame, views_[second].frame, views_[third].frame);
  const int count = static_cast<int>(matches.size());
  if (!geometry.ok()) {
    fail(count, fmt::format("{}: {}", frames, describe(geometry)));
    return std::nullopt;
  }
  const double error = geometry.rms_error * median_octave_side(matches) / rig_.pixels_per_radian();
  const double significance = geometry.least_parallax / std::max(error, 1e-9);
  if (significance < kMinSignificance) {
    const bool is_weak = ends_span && significance > kLeastSignificance &&
                         geometry.least_parallax > kBeyondFrameMotion * frame_motion(views, matches);
    weak_spans_ += is_weak;
    if (!is_weak || weak_spans_ <= kWeakSpans) {
      fail(count, fmt::format("{}: too little translation: the parallax is only {:.0f} times the error",
                              frames, significance));
      return std::nullopt;
    }
  }
  if (blur_changes(views)) {
    fail(count, fmt::format("{}: motion blur changes too much from one to the other", frames));
    return std::nullopt;
  }
  return build(views, matches, geometry, mapper);
}

std::optional<Start> Starter::build(const std::array<int, 3>& views, const std::vector<Match>& matches,
                                    const GenericStart& geometry, Mapper& mapper) {
  Start start;
  start.first_view = first_;
  Map& map = start.map;
  const Rigid3 rig_from_world[3] = {Rigid3{}, geometry.rig1_from_rig0, geometry.rig2_from_rig0};
  for (int v = 0; v < 3; ++v) {
    map.keyframes.emplace_back();
    map.keyframes[v].frame = views_[views[v]].frame;
    map.keyframes[v].rig_from_world = rig_from_world[v];
  }
  if (!geometry.scale_known) {
    map.guessed_keyframe = 2;
    map.guessed_distance = geometry.rig2_from_rig0.inverse().translation.norm();
  }
  std::vector<Match> match_of_track;
  for (size_t i = 0; i < matches.size(); ++i) {
    const Match& m = matches[i];
    if (!geometry.inlier[i]) continue;
    const int track = static_cast<int>(map.tracks.size());
    Track& started = map.tracks.emplace_back();
    started.position = geometry.points_in_rig0[i];
    started.triangulated = started.had_position = true;
    started.rgb = views_[first_].view->cameras[m.camera].rgb[m.corner];
    match_of_track.push_back(m);
    for (int v = 0; v < 3; ++v) {
      TrackPixel seen = m.seen[v];
      seen.track = track;
      if (observe(rig_, seen, v, &map) && rig_.scans()) {
        MapKeyFrame& k = map.keyframes[v];
        set_scan_offset(rig_, k.size() - 1, m.scan_offsets[v], &k);
      }
      if (v > 0) continue;
      for (const AcrossMatch& a : m.across) {
        observe(rig_, {track, static_cast<uint8_t>(a.camera), static_cast<uint8_t>(a.octave), a.pixel}, 0,
                &map);
      }
    }
  }
  for (int v = 0; v < 3; ++v)
    start.views.push_back(make_keyframe_view(views_[views[v]].view, map.keyframes[v], rig_));
  fit_surfaces(rig_, map, 0, start.views.data());
  refine_pixels({views_[views[0]].view, views_[views[1]].view, views_[views[2]].view}, &start);
  mapper.adjust_globally(&map);
  const int points = static_cast<int>(
      std::count_if(map.tracks.begin(), map.tracks.end(), [](const Track& t) { return t.triangulated; }));
  const std::vector<int> frames = {map.keyframes[0].frame, map.keyframes[1].frame, map.keyframes[2].frame};
  if (points < kMinStartInliers) {
    fail(static_cast<int>(matches.size()),
         fmt::format("frames {}, {}, {}: {} of {} points survive the adjustment", frames[0], frames[1],
                     frames[2], points, map.tracks.size()));
    return std::nullopt;
  }
  collect_seen(match_of_track, &start);
  add_points(views, &start, mapper);
  start.summary = {name_of(geometry.method), frames, points};
  return start;
}

void Starter::collect_seen(const std::vector<Match>& match_of_track, Start* start) const {
  std::vector<std::vector<int>> track_of_corner;
  for (const PairTracker& tracker : from_first_)
    track_of_corner.emplace_back(tracker.base().features.size(), -1);
  for (size_t t = 0; t < match_of_track.size(); ++t) {
    const Match& m = match_of_track[t];
    if (start->map.tracks[t].triangulated) track_of_corner[m.camera][m.corner] = static_cast<int>(t);
  }
  for (int k = 0; k < from_first_[0].views(); ++k) {
    const WaitingView& view = views_[first_ + 1 + k];
    const std::vector<SeenCorner> corners =
        view.view ? seen_corners(k, std::numeric_limits<int>::max()) : view.seen;
    std::vector<TrackPixel>& seen = start->seen.emplace_back();
    for (const SeenCorner& s : corners) {
      const int track = track_of_corner[s.camera][s.corner];
      if (track >= 0) seen.push_back({track, s.camera, s.octave, s.pixel});
    }
  }
}

// The remaining corners of the three views, matched along their epipolar lines now that these are known.
void Starter::add_points(const std::array<int, 3>& views, Start* start, Mapper& mapper) {
  Map& map = start->map;
  std::vector<KeyFrameView> completed;
  for (int v = 0; v < 3; ++v) {
    const ViewPtr& view = views_[views[v]].view;
    if (v > 0) {
      mapper.follow_tracks(v - 1, v, RigMotion{}, *view, &map, completed);
      mapper.triangulate_tracks(v, &map);
    }
    mapper.complete_keyframe(view, v, RigMotion{}, &map, &completed);
  }
  start->views = std::move(completed);
  mapper.adjust_globally(&map);
  if (options_.departures.surfaces) refine_on_surfaces(views, start, mapper);
}

// Once more, now that many points tell which way the surfaces face.
void Starter::refine_on_surfaces(const std::array<int, 3>& views, Start* start, Mapper& mapper) {
  Map& map = start->map;
  for (int v = 0; v < 3; ++v) fit_surfaces(rig_, map, v, &start->views[v]);
  refine_pixels({views_[views[0]].view, views_[views[1]].view, views_[views[2]].view}, start);
  mapper.adjust_globally(&map);
  for (int v = 0; v < 3; ++v) {
    start->views[v] = make_keyframe_view(start->views[v].view, map.keyframes[v], rig_);
    fit_surfaces(rig_, map, v, &start->views[v]);
  }
}

// With the geometry known the patches of the first view can be shaped as the others see them, and the corners
// replaced by sub-pixel places.
void Starter::refine_pixels(const std::array<ViewPtr, 3>& views, Start* start) {
  Map& map = start->map;
  std::vector<PatchQuery> queries;
  std::vector<Eigen::Vector2f> starts;
  std::vector<AlignedPatch> alignments;
  for (int v = 1; v < 3; ++v) {
    MapKeyFrame& keyframe = map.keyframes[v];
    queries.clear();
    starts.clear();
    for (int f = 0; f < keyframe.size(); ++f) {
      if (keyframe.tracks[f] < 0) continue;
      const Track& track = map.tracks[keyframe.tracks[f]];
      const TrackObservation first = track.observations[0];
      if (!track.triangulated || first.keyframe >= v) continue;
      const KeyFrameView& source = start->views[first.keyframe];
      const int camera = keyframe.cameras[f];
      const Rigid3 world_from_first = map.keyframes[first.keyframe].rig_from_world.inverse() *
                                      rig_.camera(source.cameras[first.feature]).rig_from_cam;
      const Rigid3 target_from_first = rig_.cam_from_rig(camera) * keyframe.rig_from_world * world_from_first;
      PatchQuery query{.keyframe = first.keyframe, .feature = first.feature, .track = f};
      const double distance = (track.position - world_from_first.translation).norm();
      if (!predict_patch(rig_, source, first.feature, distance, camera, target_from_first,
                         views[v]->cameras[camera], &query)) {
        continue;
      }
      queries.push_back(query);
      starts.push_back(keyframe.pixels[f]);
    }
    matcher_.align(start->views, queries, starts, *views[v], {}, &alignments);
    for (size_t i = 0; i < queries.size(); ++i) {
      const int f = queries[i].track;
      keyframe.inliers[f] = alignments[i].converged &&
                            move_observation(rig_, f, alignments[i].pixel, alignments[i].octave, &keyframe);
    }
  }
}

}  // namespace raysfm
