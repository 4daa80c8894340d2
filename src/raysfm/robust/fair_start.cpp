#include "raysfm/robust/fair_start.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// Of the matches; where more agree there is no room for another motion.
constexpr double kMostAgree = 0.85;
// Points that speak for the image: so many of each of its parts that there are about as many.
constexpr int kSpeaking = 100;
// A motion that explains a smaller part of what the other does is none of the rig's.
constexpr double kMuchLess = 0.75;
// Of the image: what the rig's motion explains at least. Of three motions of equal size it cannot be told
// which one is the rig's.
constexpr double kLeastShare = 0.5;

// Some of the points, with all their rays.
class SomeMatches {
 public:
  SomeMatches(const RigMatches& all, std::span<const int> points)
      : points_(points.begin(), points.end()), all_count_(all.point_count) {
    std::vector<int> number(all.point_count, -1);
    for (size_t i = 0; i < points.size(); ++i) number[points[i]] = static_cast<int>(i);
    for (size_t k = 0; k < all.rays.size(); ++k) {
      if (number[all.points[k]] < 0) continue;
      rays_.push_back(all.rays[k]);
      of_point_.push_back(number[all.points[k]]);
      views_.push_back(all.views[k]);
      if (!all.cameras.empty()) cameras_.push_back(all.cameras[k]);
    }
  }

  // Its points are numbered as those of all.
  GenericStart start(const GenericStartOptions& options) const {
    GenericStart some =
        start_generic({static_cast<int>(points_.size()), rays_, of_point_, views_, cameras_}, options);
    std::vector<uint8_t> inlier(all_count_, 0);
    std::vector<Eigen::Vector3d> points_in_rig0(all_count_, Eigen::Vector3d::Zero());
    for (size_t i = 0; i < some.inlier.size(); ++i) {
      inlier[points_[i]] = some.inlier[i];
      if (some.inlier[i] != 0) points_in_rig0[points_[i]] = some.points_in_rig0[i];
    }
    some.inlier.swap(inlier);
    some.points_in_rig0.swap(points_in_rig0);
    return some;
  }

 private:
  std::vector<int> points_;
  int all_count_;
  std::vector<ObservedRay> rays_;
  std::vector<int> of_point_, views_, cameras_;
};

// As many of each place, and of those with fewer all: the fewest that are enough.
std::vector<int> spread_evenly(std::span<const int> places) {
  std::vector<std::pair<int, int>> by_place;  // (place, point)
  for (size_t i = 0; i < places.size(); ++i) by_place.emplace_back(places[i], static_cast<int>(i));
  std::ranges::sort(by_place);
  std::vector<int> chosen;
  for (size_t each = 1; chosen.size() < kSpeaking && chosen.size() < places.size(); ++each) {
    chosen.clear();
    for (size_t begin = 0, end = 0; begin < by_place.size(); begin = end) {
      while (end < by_place.size() && by_place[end].first == by_place[begin].first) ++end;
      const size_t there = end - begin, taken = std::min(each, there);
      for (size_t k = 0; k < taken; ++k) chosen.push_back(by_place[begin + k * there / taken].second);
    }
  }
  return chosen;
}

bool agrees(const GenericStart& start, int point) {
  return point < static_cast<int>(start.inlier.size()) && start.inlier[point] != 0;
}

std::vector<int> unexplained(std::span<const int> points, const GenericStart& by) {
  std::vector<int> rest;
  std::ranges::copy_if(points, std::back_inserter(rest), [&](int p) { return !agrees(by, p); });
  return rest;
}

// Points that move as one, by a turn alone too.
int moving_as_one(const GenericStart& start) {
  return start.problem == StartProblem::kRotationOnly ? std::max(start.inlier_count, start.rotation_inliers)
                                                      : start.inlier_count;
}

// Whether there may be another motion that is the rig's. Where it is known that the rig turns or stands, none
// is looked for.
bool is_in_doubt(const GenericStart& start, int matches) {
  const bool has_motion = start.ok() || start.problem == StartProblem::kTooFewInliers ||
                          start.problem == StartProblem::kAmbiguous;
  return has_motion && start.inlier_count <= kMostAgree * matches;
}

}  // namespace

FairStart start_fairly(const RigMatches& matches, std::span<const int> places,
                       const GenericStartOptions& options) {
  FairStart fair{start_generic(matches, options)};
  GenericStart& first = fair.start;
  if (!is_in_doubt(first, matches.point_count)) return fair;

  std::vector<int> all(matches.point_count);
  for (int i = 0; i < matches.point_count; ++i) all[i] = i;
  const std::vector<int> speaking = spread_evenly(places);
  const std::vector<int> others = unexplained(speaking, first);
  const auto count = static_cast<double>(speaking.size());
  const double share = 1 - static_cast<double>(others.size()) / count;
  fair.rival_share = moving_as_one(SomeMatches(matches, others).start(options)) / count;

  const bool is_the_rigs = fair.rival_share <= kMuchLess * share;
  if (is_the_rigs && (first.ok() || share < kLeastShare)) return fair;
  const bool rivals =
      !is_the_rigs && share <= kMuchLess * fair.rival_share && fair.rival_share >= kLeastShare;
  if (is_the_rigs) {
    const GenericStart rival = SomeMatches(matches, unexplained(all, first)).start(options);
    first = SomeMatches(matches, unexplained(all, rival)).start(options);
  } else if (rivals) {
    first = SomeMatches(matches, unexplained(all, first)).start(options);
  } else {
    first.problem = StartProblem::kTwoMotions;
  }
  return fair;
}

}  // namespace raysfm
