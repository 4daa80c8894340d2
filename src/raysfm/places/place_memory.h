#pragma once

#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/places/meeting.h"
#include "raysfm/places/place_index.h"
#include "raysfm/scene/archive_fields.h"

namespace raysfm {

// Logarithm to base 10 of the false alarms of a place that needs no other to confirm it.
constexpr double kCertainPlace = -40;
// The same of where track ended, if enough of it is there; looks that tell the same may come to that
// together.
constexpr double kCertainEnd = -27;

template <typename A>
void archive_fields(A& a, RecognisedPlace& x) {
  archive(a, x.keyframe, x.rig_from_world, x.covariance, x.matches, x.log10_false_alarms, x.found);
}
template <typename A>
void archive_fields(A& a, TrackEnd& x) {
  archive(a, x.world, x.keyframe, x.corners, x.upright);
}
template <typename A>
void archive_fields(A& a, WorldRelation& x) {
  archive(a, x.there_from_here, x.log_scale_sigma, x.points);
}
template <typename A>
void archive_fields(A& a, Meeting& x) {
  archive(a, x.here, x.there, x.place, x.relation);
}

// The places of all worlds, and what is recognised among them. Owns scratch memory.
class PlaceMemory {
 public:
  // The rig outlives this. `seed` draws the samples.
  PlaceMemory(const TrackingRig& rig, uint64_t seed) : matcher_(rig), rig_(rig), seed_(seed) {}

  // A described key frame.
  void add(const PlaceRef& place, const MapKeyFrame& keyframe);

  int size() const { return static_cast<int>(places_.size()); }
  // By number, in the order in which they were added.
  const PlaceRef& place(int number) const { return places_[number]; }

  // The places most like what is seen, of all worlds, best first.
  std::vector<PlaceRef> most_like(const DescribedCorners& seen, int most);

  // Whether a place is what is seen at a frame.
  std::optional<RecognisedPlace> recognise(const DescribedCorners& seen, WorldMaps worlds,
                                           const PlaceRef& there, int frame);

  // Looks whether a described key frame shows a place that is known already: of another world, or of its own
  // where no points tie the two together. Places that are `at_hand`, by their number, are not looked for.
  // Then the key frame becomes a place; or, where one of its world is as good, loses its descriptors.
  std::optional<Meeting> meet(const PlaceRef& here, WorldMaps worlds,
                              const std::function<bool(int)>& at_hand);

  // Where track ended. The newest few are kept.
  void add_end(TrackEnd end);
  bool has_end_outside(int world) const;
  // Whether the upright corners of a key frame show where track ended in another world; of several ends that
  // which is surest. Another look may have to confirm it.
  std::optional<Meeting> meet_end(const PlaceRef& here, const DescribedCorners& seen, WorldMaps worlds);

  // Whether what was met in another world is sure: it is `certain`, or told again.
  bool is_confirmed(const Meeting& meeting, WorldMaps worlds, double certain = kCertainPlace);

  // Whether what was met says the same as the last that was asked for, and enough with those that did so
  // before.
  bool is_told_again(const Meeting& meeting, WorldMaps worlds);

  // After join_worlds().
  void renumber(const JoinedWorlds& joined);
  // After fuse_points() in a world, which returned this.
  void rename_tracks(int world, std::span<const int> track_now);

  // After drop_keyframes() of a world: places of key frames that stand for nothing new (1; by their old
  // number, shorter: the rest does) are forgotten. `keyframe_now` is what it returned.
  void drop(int world, std::span<const uint8_t> is_known, std::span<const int> keyframe_now);

  // All places, which frees their memory.
  void forget();

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, index_, unfiled_, places_, ends_, hearsay_);
  }

 private:
  void renumber(int world, int into, std::span<const int> keyframes, int first_track);
  std::vector<PlaceVotes> likely_places(const PlaceRef& here, const Map& map,
                                        const std::function<bool(int)>& at_hand);
  void file_until(int number);
  std::optional<Meeting> look_closely(const PlaceRef& here, WorldMaps worlds,
                                      const std::vector<PlaceVotes>& likely);
  std::optional<Meeting> compare(const PlaceRef& here, const DescribedCorners& seen, const PlaceRef& there,
                                 RecognisedPlace place, WorldMaps worlds);

  PlaceMatcher matcher_;
  PlaceIndex index_;
  // Of the places after those of the index: nothing was looked for among them yet, and in most videos nothing
  // ever is among those that are at hand.
  std::deque<PlaceIndex::Signatures> unfiled_;
  std::vector<PlaceRef> places_;  // by their number
  std::deque<TrackEnd> ends_;     // oldest first
  // To be confirmed by another. Its false alarms are those of all that said the same before it, too.
  std::optional<Meeting> hearsay_;
  const TrackingRig& rig_;
  uint64_t seed_;
};

}  // namespace raysfm
