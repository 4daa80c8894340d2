#include "raysfm/photos/photo_lenses.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

constexpr double kMostSigmas = 3;  // by which a focal length may be another than it is said to be

// A lens with what tells it from others.
struct NamedLens {
  PhotoExif exif;
  int width, height;
  ExifFocal focal;

  bool same_as(const NamedLens& other) const {
    return exif.camera == other.exif.camera && exif.lens == other.exif.lens &&
           exif.focal_mm == other.exif.focal_mm && exif.focal_35mm == other.exif.focal_35mm &&
           width == other.width && height == other.height && focal.px == other.focal.px &&
           focal.defect == other.focal.defect;
  }
};

ExifLens report_of(const NamedLens& named, const std::string& photo) {
  ExifLens lens;
  lens.camera = named.exif.camera;
  lens.lens = named.exif.lens;
  lens.focal_mm = named.exif.focal_mm;
  lens.first_photo = photo;
  lens.focal_px = named.focal.px;
  lens.focal_sigma_px = named.focal.sigma * named.focal.px;
  lens.source = named.focal.source;
  lens.not_used = named.focal.defect;
  if (lens.not_used.empty() && !(named.focal.px > 0)) lens.not_used = "does not say a focal length in pixels";
  return lens;
}

// Lenses in the order of the photos, and of each photo the number of its own, -1: not said.
struct Grouped {
  std::vector<NamedLens> lenses;
  std::vector<int> number;
  bool all = true;  // say one, but for those without pixels, which were taken with none
};

Grouped group_by_lens(std::span<const TakenPhoto> photos) {
  Grouped grouped;
  for (const TakenPhoto& photo : photos) {
    grouped.all = grouped.all && (photo.exif || photo.size.isZero());
    grouped.number.push_back(-1);
    if (!photo.exif) continue;
    const NamedLens one{*photo.exif, photo.size.x(), photo.size.y(),
                        focal_of_exif(*photo.exif, photo.size.x(), photo.size.y())};
    const auto same =
        std::ranges::find_if(grouped.lenses, [&](const NamedLens& other) { return one.same_as(other); });
    grouped.number.back() = static_cast<int>(same - grouped.lenses.begin());
    if (same == grouped.lenses.end()) grouped.lenses.push_back(one);
  }
  return grouped;
}

}  // namespace

std::vector<ExifLens> lenses_by_exif(std::span<const TakenPhoto> photos) {
  const Grouped grouped = group_by_lens(photos);
  std::vector<ExifLens> lenses;
  for (size_t i = 0; i < photos.size(); ++i) {
    const int number = grouped.number[i];
    if (number < 0) continue;
    if (number == std::ssize(lenses)) lenses.push_back(report_of(grouped.lenses[number], photos[i].name));
    ++lenses[number].photos;
  }
  for (ExifLens& lens : lenses) {
    if (!lens.not_used.empty()) continue;
    if (lenses.size() > 1) lens.not_used = fmt::format("one of {} lenses of these photos", lenses.size());
    if (lenses.size() == 1 && !grouped.all) lens.not_used = "other photos do not say how they were taken";
  }
  return lenses;
}

std::vector<int> numbers_of_lenses(std::span<const TakenPhoto> photos) {
  Grouped grouped = group_by_lens(photos);
  const auto taken = std::ranges::count_if(grouped.number, [](int number) { return number >= 0; });
  if (!grouped.all || grouped.lenses.size() < 2 || std::ssize(grouped.lenses) == taken) return {};
  return std::move(grouped.number);
}

ExifLens* lens_to_use(std::vector<ExifLens>* lenses) {
  const auto found =
      std::ranges::find_if(*lenses, [](const ExifLens& lens) { return lens.not_used.empty(); });
  return found == lenses->end() ? nullptr : &*found;
}

std::string contradiction(const ExifLens& said, double found_px) {
  if (std::abs(found_px - said.focal_px) <= kMostSigmas * said.focal_sigma_px) return {};
  return fmt::format("contradicted by the photos, which say {:.1f} px", found_px);
}

void tell_exif(std::span<const ExifLens> lenses, const EventSink& event) {
  for (const ExifLens& lens : lenses) {
    const std::string camera = lens.camera.empty() ? "a camera without a name" : lens.camera;
    const std::string focal = lens.focal_px > 0 ? fmt::format(": {:.0f} px, give or take {:.0f} ({})",
                                                              lens.focal_px, lens.focal_sigma_px, lens.source)
                                                : std::string();
    const std::string others = lens.photos > 1 ? fmt::format(" and {} more", lens.photos - 1) : std::string();
    const std::string what = fmt::format("EXIF of {}{}, by {}{}", lens.first_photo, others, camera, focal);
    if (lens.not_used.empty()) {
      tell(event, Event::Level::kInfo, what + "; used as a prior");
    } else {
      tell(event, Event::Level::kWarning, fmt::format("{}; not used: {}", what, lens.not_used));
    }
  }
}

}  // namespace raysfm
