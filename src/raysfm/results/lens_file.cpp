#include "raysfm/results/lens_file.h"

#include <fmt/format.h>

#include <string>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"

namespace raysfm {

Result<void> write_lens_file(std::span<const LensOfFrame> lenses, const std::filesystem::path& path) {
  std::string text = "timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma\n";
  for (const LensOfFrame& lens : lenses) {
    text += timestamp_text(lens.timestamp);
    for (const double value : lens.value) text += fmt::format(",{:.6f}", value);
    for (const double sigma : lens.sigma) text += fmt::format(",{:.6g}", sigma);
    text += '\n';
  }
  return write_file(path, text);
}

}  // namespace raysfm
