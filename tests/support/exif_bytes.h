#pragma once

#include <cstdint>
#include <string>
#include <vector>

// EXIF by hand, after Exif 2.32 section 4.6 and TIFF 6.0.
namespace raysfm::testing_support {

struct ExifText {
  std::string maker = {}, model = {}, lens = {};
  double focal_mm = 0;
  int focal_35mm = 0;
  int pixels_per_inch = 0;  // of the sensor
  int width = 0, height = 0;
};

class TiffWriter {
 public:
  explicit TiffWriter(bool big_endian) : big_endian_(big_endian) {}

  void number(std::string* to, uint32_t value, int bytes) const {
    for (int i = 0; i < bytes; ++i) {
      const int shift = 8 * (big_endian_ ? bytes - 1 - i : i);
      to->push_back(static_cast<char>(value >> shift & 0xff));
    }
  }
  void text(int tag, const std::string& value) {
    if (!value.empty()) add(tag, 2, static_cast<uint32_t>(value.size() + 1), value + '\0');
  }
  void short_number(int tag, int value) {
    std::string bytes;
    number(&bytes, static_cast<uint32_t>(value), 2);
    add(tag, 3, 1, bytes);
  }
  void long_number(int tag, uint32_t value) {
    std::string bytes;
    number(&bytes, value, 4);
    add(tag, 4, 1, bytes);
  }
  void rational(int tag, double value) {
    constexpr uint32_t kDenominator = 10000;
    std::string bytes;
    number(&bytes, static_cast<uint32_t>(value * kDenominator + 0.5), 4);
    number(&bytes, kDenominator, 4);
    add(tag, 5, 1, bytes);
  }
  // The directory, if it begins so many bytes after the beginning of the TIFF.
  std::string directory(size_t begin) const {
    std::string entries, data;
    const size_t end = begin + 2 + 12 * fields_.size() + 4;
    number(&entries, static_cast<uint32_t>(fields_.size()), 2);
    for (const Field& field : fields_) {
      number(&entries, static_cast<uint32_t>(field.tag), 2);
      number(&entries, static_cast<uint32_t>(field.type), 2);
      number(&entries, field.count, 4);
      if (field.bytes.size() <= 4) {
        entries += field.bytes + std::string(4 - field.bytes.size(), '\0');
        continue;
      }
      number(&entries, static_cast<uint32_t>(end + data.size()), 4);
      data += field.bytes;
    }
    number(&entries, 0, 4);
    return entries + data;
  }

 private:
  struct Field {
    int tag, type;
    uint32_t count;
    std::string bytes;
  };
  void add(int tag, int type, uint32_t count, std::string bytes) {
    fields_.push_back({tag, type, count, std::move(bytes)});
  }

  bool big_endian_;
  std::vector<Field> fields_;
};

// The TIFF of an EXIF.
inline std::string exif_bytes(const ExifText& text, bool big_endian) {
  TiffWriter sub(big_endian);
  if (text.focal_mm > 0) sub.rational(0x920a, text.focal_mm);
  if (text.width > 0) sub.long_number(0xa002, static_cast<uint32_t>(text.width));
  if (text.height > 0) sub.long_number(0xa003, static_cast<uint32_t>(text.height));
  if (text.pixels_per_inch > 0) {
    sub.rational(0xa20e, text.pixels_per_inch);
    sub.rational(0xa20f, text.pixels_per_inch);
    sub.short_number(0xa210, 2);
  }
  if (text.focal_35mm > 0) sub.short_number(0xa405, text.focal_35mm);
  sub.text(0xa434, text.lens);
  const auto first = [&](uint32_t sub_begin) {
    TiffWriter main(big_endian);
    main.text(0x010f, text.maker);
    main.text(0x0110, text.model);
    main.long_number(0x8769, sub_begin);
    return main.directory(8);
  };
  const size_t sub_begin = 8 + first(0).size();
  std::string tiff = big_endian ? "MM" : "II";
  const TiffWriter head(big_endian);
  head.number(&tiff, 42, 2);
  head.number(&tiff, 8, 4);
  return tiff + first(static_cast<uint32_t>(sub_begin)) + sub.directory(sub_begin);
}

// Files without pixels: what readers of EXIF look at.
inline std::string jpeg_with_exif(const std::string& tiff) {
  std::string file = "\xff\xd8";
  if (!tiff.empty()) {
    const std::string data = std::string("Exif\0\0", 6) + tiff;
    file += "\xff\xe1";
    TiffWriter(true).number(&file, static_cast<uint32_t>(data.size() + 2), 2);
    file += data;
  }
  return file + "\xff\xd9";
}

inline std::string chunk_of_png(const std::string& type, const std::string& data) {
  std::string chunk;
  TiffWriter(true).number(&chunk, static_cast<uint32_t>(data.size()), 4);
  chunk += type + data;
  uint32_t crc = 0xffffffff;  // PNG specification, annex D
  for (size_t i = 4; i < chunk.size(); ++i) {
    crc ^= static_cast<uint8_t>(chunk[i]);
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? 0xedb88320 ^ crc >> 1 : crc >> 1;
  }
  TiffWriter(true).number(&chunk, ~crc, 4);
  return chunk;
}

inline std::string png_with_exif(const std::string& tiff) {
  return "\x89PNG\r\n\x1a\n" + chunk_of_png("IHDR", std::string(13, '\0')) + chunk_of_png("eXIf", tiff) +
         chunk_of_png("IEND", "");
}

}  // namespace raysfm::testing_support
