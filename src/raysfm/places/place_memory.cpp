#include "raysfm/places/place_memory.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace raysfm {
namespace {

constexpr double kSamePlace = 0.3;  // of its described points, that it shares with one that is met again
constexpr double kConnected = 0.2;  // of its points, that it shares with a place that it is tied to
// Places looked at closely: those of most votes, where these are more than chance gives: standard deviations
// of a count.
constexpr int kMostLookedAt = 3;
constexpr double kProminent = 4;
// Logarithm to base 10 of the false alarms of a place that is believed when it fits what is known.
constexpr double kSignificant = -20;
// The same of where track ended in another world, when another look is to confirm it.
constexpr double kSuspectedEnd = -4;
// Of it so much must be there (RecognisedPlace::found). Of a room with one or two seconds cut out of its
// film, right poses of 11 cuts have 0.22 to 0.41, wrong ones 0.18 to 0.21. Unrelated corridors and rooms with
// the same bricks, windows or rugs come to false alarms of -67, several of which agree, but to 0.20 (once
// 0.23).
constexpr double kLeastFound = 0.24;
constexpr size_t kMostEnds = 4;  // 80 KB each
// The same place: parts of the distance to the points, radians.
constexpr double kSamePlaceShift = 0.1, kSamePlaceTurn = 0.1;

bool is_sure(const std::optional<RecognisedPlace>& place, double most_false_alarms) {
  return place && place->log10_false_alarms < most_false_alarms;
}

}  // namespace

void PlaceMemory::add(const PlaceRef& place, const MapKeyFrame& keyframe) {
  unfiled_.push_back(PlaceIndex::signatures_of(keyframe.descriptors));
  places_.push_back(place);
}

// Files the places before this one.
void PlaceMemory::file_until(int number) {
  for (; index_.size() < number; unfiled_.pop_front()) index_.file(unfiled_.front());
}

std::vector<PlaceRef> PlaceMemory::most_like(const DescribedCorners& seen, int most) {
  std::vector<PlaceRef> places;
  file_until(size());
  for (const PlaceVotes& v : index_.search(seen.descriptors, {}, most)) places.push_back(places_[v.place]);
  return places;
}

std::optional<RecognisedPlace> PlaceMemory::recognise(const DescribedCorners& seen, WorldMaps worlds,
                                                      const PlaceRef& there, int frame) {
  return matcher_.recognise(seen, *worlds[there.world], there.keyframe, seed_, static_cast<uint64_t>(frame));
}

std::optional<Meeting> PlaceMemory::meet(const PlaceRef& here, WorldMaps worlds,
                                         const std::function<bool(int)>& at_hand) {
  MapKeyFrame& k = worlds[here.world]->keyframes[here.keyframe];
  std::optional<Meeting> meeting =
      look_closely(here, worlds, likely_places(here, *worlds[here.world], at_hand));
  if (meeting && meeting->there.world == here.world &&
      static_cast<double>(meeting->relation.points.size()) >
          kSamePlace * static_cast<double>(k.descriptors.size())) {
    k.described.clear();  // the other one is as good
    k.descriptors.clear();
  } else {
    add(here, k);
  }
  return meeting;
}

// Those that stand out by their votes.
std::vector<PlaceVotes> PlaceMemory::likely_places(const PlaceRef& here, const Map& map,
                                                   const std::function<bool(int)>& at_hand) {
  const std::vector<int> shared = shared_points(map, here.keyframe);
  std::vector<uint8_t> is_known;
  int asked = 0;  // places until the last that is not known
  for (int p = 0; p < size(); ++p) {
    const PlaceRef& place = places_[p];
    // The local map has what is near in time, and tracks tie together what was seen without a gap.
    is_known.push_back(at_hand(p) || (place.world == here.world &&
                                      shared[place.keyframe] > kConnected * shared[here.keyframe]));
    if (!is_known.back()) asked = p + 1;
  }
  if (asked == 0) return {};
  file_until(asked);
  std::vector<PlaceVotes> likely =
      index_.search(map.keyframes[here.keyframe].descriptors, is_known, kMostLookedAt);
  const bool is_only_one = std::ranges::count(is_known, 0) == 1;
  std::erase_if(likely, [&](const PlaceVotes& v) {
    return !is_only_one && v.votes < v.by_chance + kProminent * std::sqrt(v.by_chance);
  });
  return likely;
}

// Where two places far from each other are recognised alike, the footage repeats itself and neither is
// believed.
std::optional<Meeting> PlaceMemory::look_closely(const PlaceRef& here, WorldMaps worlds,
                                                 const std::vector<PlaceVotes>& likely) {
  const Map& map = *worlds[here.world];
  const MapKeyFrame& keyframe = map.keyframes[here.keyframe];
  const DescribedCorners seen = described_corners(keyframe);
  std::vector<Meeting> meetings;
  for (const PlaceVotes& v : likely) {
    const PlaceRef& there = places_[v.place];
    std::optional<RecognisedPlace> place = recognise(seen, worlds, there, keyframe.frame);
    if (!is_sure(place, kSignificant)) continue;
    auto meeting = compare(here, seen, there, *std::move(place), worlds);
    if (meeting) meetings.push_back(*std::move(meeting));
  }
  if (meetings.empty()) return std::nullopt;
  const auto best = std::ranges::max_element(
      meetings, {}, [](const Meeting& m) { return static_cast<int>(m.relation.points.size()); });
  if (best->there.world == here.world && !is_plausible(*best, map)) return std::nullopt;
  const double distance = best->relation.there_from_here.scale * median_distance(keyframe, map);
  for (const Meeting& other : meetings) {
    if (other.there.world != best->there.world) continue;
    const Rigid3 apart = other.place.rig_from_world * best->place.rig_from_world.inverse();
    const bool same = apart.translation.norm() < kSamePlaceShift * distance &&
                      log_so3(apart.rotation).norm() < kSamePlaceTurn;
    if (!same && 2 * other.relation.points.size() > best->relation.points.size()) return std::nullopt;
  }
  return std::move(*best);
}

// What was recognised, where the points of both worlds agree with it.
std::optional<Meeting> PlaceMemory::compare(const PlaceRef& here, const DescribedCorners& seen,
                                            const PlaceRef& there, RecognisedPlace place, WorldMaps worlds) {
  const Map &map_here = *worlds[here.world], &map_there = *worlds[there.world];
  std::optional<WorldRelation> relation = relate_worlds(rig_, map_here, here.keyframe, seen, map_there, place,
                                                        has_same_scale(rig_, map_here, map_there));
  if (!relation) return std::nullopt;
  return Meeting{here, there, std::move(place), *std::move(relation)};
}

void PlaceMemory::add_end(TrackEnd end) {
  ends_.push_back(std::move(end));
  if (ends_.size() > kMostEnds) ends_.pop_front();
}

bool PlaceMemory::has_end_outside(int world) const {
  return std::ranges::any_of(ends_, [&](const TrackEnd& end) { return end.world != world; });
}

std::optional<Meeting> PlaceMemory::meet_end(const PlaceRef& here, const DescribedCorners& seen,
                                             WorldMaps worlds) {
  const auto frame = static_cast<uint64_t>(worlds[here.world]->keyframes[here.keyframe].frame);
  std::optional<Meeting> best;
  double least = kSuspectedEnd;
  for (auto end = ends_.rbegin(); end != ends_.rend(); ++end) {
    if (end->world == here.world) continue;
    auto place = matcher_.recognise(seen, *worlds[end->world], *end, seed_, frame);
    if (!is_sure(place, least) || place->found < kLeastFound) continue;
    const double false_alarms = place->log10_false_alarms;
    auto meeting = compare(here, seen, {end->world, end->keyframe}, *std::move(place), worlds);
    if (!meeting) continue;
    least = false_alarms;
    best = std::move(meeting);
  }
  return best;
}

bool PlaceMemory::is_confirmed(const Meeting& meeting, WorldMaps worlds, double certain) {
  return meeting.place.log10_false_alarms < certain || is_told_again(meeting, worlds);
}

bool PlaceMemory::is_told_again(const Meeting& meeting, WorldMaps worlds) {
  const std::optional<Meeting> before = std::exchange(hearsay_, meeting);
  if (!before || !tell_the_same(meeting, *before, *worlds[meeting.here.world])) return false;
  hearsay_->place.log10_false_alarms += before->place.log10_false_alarms;
  return hearsay_->place.log10_false_alarms < kCertainEnd;
}

void PlaceMemory::renumber(const JoinedWorlds& joined) {
  renumber(joined.first, joined.first, joined.numbers.keyframe_of_first, 0);
  renumber(joined.second, joined.first, joined.numbers.keyframe_of_second,
           joined.numbers.first_track_of_second);
  hearsay_.reset();
}

void PlaceMemory::renumber(int world, int into, std::span<const int> keyframes, int first_track) {
  for (PlaceRef& place : places_) {
    if (place.world == world) place = {into, keyframes[place.keyframe]};
  }
  for (TrackEnd& end : ends_) {
    if (end.world != world) continue;
    end.world = into;
    end.keyframe = keyframes[end.keyframe];
    for (TrackPixel& corner : end.corners) corner.track += first_track;
  }
}

void PlaceMemory::drop(int world, std::span<const uint8_t> is_known, std::span<const int> keyframe_now) {
  std::vector<uint8_t> stays;
  std::vector<PlaceRef> staying;
  for (const PlaceRef& place : places_) {
    const size_t k = place.keyframe;
    stays.push_back(place.world != world || k >= is_known.size() || !is_known[k]);
    if (stays.back()) staying.push_back(place);
  }
  std::erase_if(ends_, [&](const TrackEnd& end) {
    return end.world == world && end.keyframe < std::ssize(is_known) && is_known[end.keyframe];
  });
  if (staying.size() < places_.size()) {
    file_until(size());
    index_.keep(stays);
  }
  places_ = std::move(staying);
  renumber(world, world, keyframe_now, 0);
}

void PlaceMemory::rename_tracks(int world, std::span<const int> track_now) {
  for (TrackEnd& end : ends_) {
    if (end.world != world) continue;
    for (TrackPixel& corner : end.corners) corner.track = track_now[corner.track];
  }
}

void PlaceMemory::forget() {
  index_ = {};
  unfiled_.clear();
  places_ = std::vector<PlaceRef>();
  ends_.clear();
  hearsay_.reset();
}

}  // namespace raysfm
