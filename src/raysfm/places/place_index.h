#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "raysfm/core/archive.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/core/slab_allocator.h"
#include "raysfm/features/descriptor.h"

namespace raysfm {

// A place that may show what was asked for.
struct PlaceVotes {
  int place = 0;
  int votes = 0;         // descriptors asked for that look more like one of this place than of most others
  double by_chance = 0;  // votes that each place would have if nothing had been seen before
};

// Finds the places, of any number, that share descriptors with what is asked for, without a vocabulary: 64 of
// the bits of every descriptor are filed under each quarter of theirs (locality-sensitive hashing; Indyk and
// Motwani 1998), and those that share a quarter are compared in all 64. 48 bytes a descriptor.
class PlaceIndex {
 public:
  // What of a place's descriptors is filed: the bits of each.
  using Signatures = std::vector<uint64_t>;
  static Signatures signatures_of(std::span<const Descriptor> descriptors);

  // Returns the number of the new place: 0, 1, 2, ...
  int file(const Signatures& signatures);
  int add(std::span<const Descriptor> descriptors) { return file(signatures_of(descriptors)); }

  int size() const { return size_; }

  // Places that do not stay (0; one entry for each) are forgotten, and the others numbered anew in their
  // order.
  void keep(std::span<const uint8_t> stays);

  // Every descriptor votes for the two places that have the ones most like it, of those that are not to be
  // skipped (1; by place, shorter: none of the rest). Of more than 1000 places, not all descriptors are asked
  // for. The `most` places with most votes, best first, the
  // lower number first where votes are equal.
  std::vector<PlaceVotes> search(std::span<const Descriptor> descriptors, std::span<const uint8_t> skip,
                                 int most) const;

  template <typename A>
  void archive(A& a) {
    raysfm::archive(a, numbers_, buckets_, size_);
  }

 private:
  struct TwoNearest;
  // What was filed under one value of a quarter.
  struct Bucket {
    std::vector<uint64_t, SlabAllocator<uint64_t>> signatures;  // the 64 bits
    std::vector<uint32_t, SlabAllocator<uint32_t>> places;

    template <typename A>
    void archive(A& a) {
      raysfm::archive(a, signatures, places);
    }
    // Offers the places of the signatures that are near one.
    void offer_near(uint64_t signature, std::span<const uint8_t> is_skipped, TwoNearest* nearest) const;
  };
  void fetch_ahead(std::span<const uint64_t> asked_for, size_t now) const;
  // Null: nothing was filed there.
  const Bucket* find(uint64_t signature, int part) const;

  LargeArray<uint32_t> numbers_;  // of the buckets of one quarter after another, from 1; 0: none yet
  std::deque<Bucket, SlabAllocator<Bucket>> buckets_;
  int size_ = 0;
};

}  // namespace raysfm
