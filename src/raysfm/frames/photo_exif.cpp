#include "raysfm/frames/photo_exif.h"

#include <fmt/format.h>
#include <libexif/exif-data.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>

#include "raysfm/files/text_file.h"
#include "raysfm/frames/png_chunks.h"

namespace raysfm {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kPngHead = "\x89PNG\r\n\x1a\n"sv, kExifHead = "Exif\0\0"sv;
// A segment of a JPEG has at most 64 KiB, and that of the camera is one of the first.
constexpr size_t kMostExif = size_t{1} << 18;
constexpr double kMmOfInch = 25.4;

struct FreeExif {
  void operator()(ExifData* data) const { exif_data_unref(data); }
};
using ExifPointer = std::unique_ptr<ExifData, FreeExif>;

std::string read_head(std::istream& file, size_t most) {
  std::string bytes(most, '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(most));
  bytes.resize(static_cast<size_t>(file.gcount()));
  return bytes;
}

// The data of the chunk eXIf, with what is ahead of it in a JPEG; empty where there is none.
std::string exif_of_png(std::istream& file) {
  for (;;) {
    const std::string head = read_head(file, 8);
    if (head.size() < 8) return {};
    const size_t data = big_endian(head);
    const std::string_view type = std::string_view(head).substr(4);
    if (type == "IEND") return {};
    if (type == "eXIf") {
      const std::string bytes = data <= kMostExif ? read_head(file, data) : "";
      return bytes.size() == data && data > 0 ? std::string(kExifHead) + bytes : "";
    }
    file.seekg(static_cast<std::streamoff>(data) + 4, std::ios::cur);
  }
}

ExifPointer load_exif(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string bytes = read_head(file, kPngHead.size());
  if (bytes == kPngHead) {
    bytes = exif_of_png(file);
  } else {
    bytes += read_head(file, kMostExif);
  }
  if (bytes.empty()) return nullptr;
  ExifPointer data(exif_data_new());
  if (!data) return nullptr;
  // It would make up what the specification asks for and the file has not.
  exif_data_unset_option(data.get(), EXIF_DATA_OPTION_FOLLOW_SPECIFICATION);
  exif_data_load_data(data.get(), reinterpret_cast<const unsigned char*>(bytes.data()),
                      static_cast<unsigned>(bytes.size()));
  return data;
}

const ExifEntry* entry_of(const ExifData& data, ExifIfd ifd, ExifTag tag) {
  return exif_content_get_entry(data.ifd[ifd], tag);
}

std::string text_of(const ExifEntry* entry) {
  if (!entry || entry->format != EXIF_FORMAT_ASCII || !entry->data) return {};
  std::string text(reinterpret_cast<const char*>(entry->data), entry->size);
  text.resize(std::min(text.find('\0'), text.size()));
  std::erase_if(text, [](char c) { return c < ' ' || c > '~'; });
  return std::string(trimmed(text));
}

// 0 for what is no number above 0.
double number_of(const ExifData& data, const ExifEntry* entry) {
  if (!entry || !entry->data || entry->components < 1) return 0;
  const ExifByteOrder order = exif_data_get_byte_order(const_cast<ExifData*>(&data));
  double number = 0;
  if (entry->format == EXIF_FORMAT_SHORT && entry->size >= 2) number = exif_get_short(entry->data, order);
  if (entry->format == EXIF_FORMAT_LONG && entry->size >= 4) number = exif_get_long(entry->data, order);
  if (entry->format == EXIF_FORMAT_RATIONAL && entry->size >= 8) {
    const ExifRational r = exif_get_rational(entry->data, order);
    number = r.denominator > 0 ? static_cast<double>(r.numerator) / r.denominator : 0;
  }
  return number;
}

// Pixels in a millimetre of the sensor.
double plane_resolution(const ExifData& data) {
  constexpr int kCentimetre = 3, kMillimetre = 4, kMicrometre = 5;
  const auto number = [&](ExifTag tag) { return number_of(data, entry_of(data, EXIF_IFD_EXIF, tag)); };
  const double resolution = number(EXIF_TAG_FOCAL_PLANE_X_RESOLUTION);
  switch (static_cast<int>(number(EXIF_TAG_FOCAL_PLANE_RESOLUTION_UNIT))) {
    case kCentimetre:
      return resolution / 10;
    case kMillimetre:
      return resolution;
    case kMicrometre:
      return resolution * 1000;
    default:
      return resolution / kMmOfInch;
  }
}

int side_of(double number) {
  constexpr double kMostPixels = 1e6;
  return number <= kMostPixels ? static_cast<int>(number) : 0;
}

// A focal length in pixels by the form of 35 mm, 0 where it is not said: of the diagonal (CIPA DCG-001).
double focal_by_film(const PhotoExif& exif, int width, int height) {
  const double film = std::hypot(36, 24);
  return exif.focal_35mm * std::hypot(width, height) / film;
}

}  // namespace

std::optional<PhotoExif> read_exif(const std::filesystem::path& path) {
  const ExifPointer data = load_exif(path);
  if (!data) return std::nullopt;
  const auto text = [&](ExifIfd ifd, ExifTag tag) { return text_of(entry_of(*data, ifd, tag)); };
  const auto number = [&](ExifTag tag) { return number_of(*data, entry_of(*data, EXIF_IFD_EXIF, tag)); };
  PhotoExif exif;
  const std::string maker = text(EXIF_IFD_0, EXIF_TAG_MAKE), model = text(EXIF_IFD_0, EXIF_TAG_MODEL);
  // Many models begin with their maker.
  exif.camera =
      model.starts_with(maker) || model.empty() ? (model.empty() ? maker : model) : maker + " " + model;
  exif.lens = text(EXIF_IFD_EXIF, EXIF_TAG_LENS_MODEL);
  exif.focal_mm = number(EXIF_TAG_FOCAL_LENGTH);
  exif.focal_35mm = number(EXIF_TAG_FOCAL_LENGTH_IN_35MM_FILM);
  exif.pixels_per_mm = plane_resolution(*data);
  exif.width = side_of(number(EXIF_TAG_PIXEL_X_DIMENSION));
  exif.height = side_of(number(EXIF_TAG_PIXEL_Y_DIMENSION));
  const bool says_something = !exif.camera.empty() || exif.focal_mm > 0 || exif.focal_35mm > 0;
  return says_something ? std::optional(exif) : std::nullopt;
}

ExifFocal focal_of_exif(const PhotoExif& exif, int width, int height) {
  // Makers round, and leave out what focusing does.
  constexpr double kSigma = 0.03, kRounding = 0.3, kMostApart = 0.15;
  constexpr double kLeast = 0.1, kMost = 100;  // of the larger side: what a lens can be
  ExifFocal focal;
  const double by_film = focal_by_film(exif, width, height);
  const double by_sensor = exif.focal_mm * exif.pixels_per_mm;
  if (!(by_film > 0) && !(by_sensor > 0)) return focal;
  if (exif.width == 0 || exif.height == 0) {
    focal.defect = "does not say of how many pixels the photo was, so that a crop would not be seen";
    return focal;
  }
  // Upright photos are often turned without that their numbers are.
  const bool same =
      (exif.width == width && exif.height == height) || (exif.width == height && exif.height == width);
  if (!same) {
    focal.defect = fmt::format("is of a photo of {}x{} pixels, this one has {}x{}: cropped or resized",
                               exif.width, exif.height, width, height);
    return focal;
  }
  if (by_film > 0 && by_sensor > 0 && std::abs(std::log(by_film / by_sensor)) > kMostApart) {
    focal.defect = fmt::format("contradicts itself: {:.0f} px by the form of 35 mm, {:.0f} px by the sensor",
                               by_film, by_sensor);
    return focal;
  }
  const double px = by_sensor > 0 ? by_sensor : by_film;
  const double side = std::max(width, height);
  if (!(px > kLeast * side && px < kMost * side)) {
    focal.defect = fmt::format("says {:.4g} px, which no lens of a photo of {}x{} has", px, width, height);
    return focal;
  }
  focal.px = px;
  focal.sigma = by_sensor > 0 ? kSigma : std::hypot(kSigma, kRounding / exif.focal_35mm);
  focal.source = by_sensor > 0 ? fmt::format("{:.4g} mm on a sensor of {:.4g} pixels per mm", exif.focal_mm,
                                             exif.pixels_per_mm)
                               : fmt::format("{:.4g} mm in the form of 35 mm", exif.focal_35mm);
  return focal;
}

}  // namespace raysfm
