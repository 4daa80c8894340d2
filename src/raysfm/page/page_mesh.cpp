#include "raysfm/page/page_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

constexpr uintmax_t kMostOfPage = 3 << 20;  // bytes of faces and texture
constexpr uintmax_t kMostObjBytes = 64 << 20;
constexpr size_t kBytesOfFace = 30;  // about, with its share of the vertices

// Collects the lines of mesh.obj.
class ObjReader {
 public:
  explicit ObjReader(PageMesh* mesh) : mesh_(*mesh) {}

  // False where the line is none that an export writes.
  bool take(std::string_view line) {
    const std::vector<std::string_view> words = split_words(line);
    if (words.empty() || words[0] == "mtllib" || words[0] == "usemtl") return true;
    if (words[0] == "v")
      return numbers(words, 3, [&](double x) { mesh_.positions.push_back(static_cast<float>(x)); });
    if (words[0] == "vt") {
      return numbers(words, 2, [&](double x) {
        places_.push_back(static_cast<uint16_t>(std::lround(65535 * std::clamp(x, 0.0, 1.0))));
      });
    }
    return words[0] == "f" && words.size() == 4 && corner(words[1]) && corner(words[2]) && corner(words[3]);
  }

 private:
  template <typename Take>
  static bool numbers(const std::vector<std::string_view>& words, size_t count, Take take) {
    if (words.size() != count + 1) return false;
    for (size_t i = 1; i <= count; ++i) {
      const std::optional<double> number = parse_number(words[i]);
      if (!number || !std::isfinite(*number)) return false;
      take(*number);
    }
    return true;
  }

  bool corner(std::string_view word) {
    const size_t slash = word.find('/');
    if (slash == word.npos) return false;
    const std::optional<int64_t> vertex = parse_integer(word.substr(0, slash)),
                                 place = parse_integer(word.substr(slash + 1));
    const auto vertices = static_cast<int64_t>(mesh_.positions.size() / 3),
               places = static_cast<int64_t>(places_.size() / 2);
    if (!vertex || !place || *vertex < 1 || *vertex > vertices || *place < 1 || *place > places) return false;
    mesh_.faces.push_back(static_cast<uint32_t>(*vertex - 1));
    mesh_.places.insert(mesh_.places.end(), {places_[2 * *place - 2], places_[2 * *place - 1]});
    return true;
  }

  PageMesh& mesh_;
  std::vector<uint16_t> places_;
};

}  // namespace

fs::path mesh_folder_of(const fs::path& result) {
  std::error_code failure;
  const fs::path folder = fs::canonical(result, failure);
  const fs::path beside = failure ? fs::path() : fs::path(folder.string() + "-mesh");
  return !beside.empty() && fs::is_regular_file(beside / "mesh.obj", failure) ? beside : fs::path();
}

Result<PageMesh> read_page_mesh(const fs::path& folder) {
  const fs::path manifest = folder / "export.json", obj = folder / "mesh.obj", picture = folder / "mesh.jpg";
  PageMesh mesh;
  const Result<std::string> told = read_text_file(manifest, kMostOfPage);
  if (!told) return told.error();
  const auto json = nlohmann::json::parse(*told, nullptr, false);
  if (!json.is_object() || !json.contains("world") || !json["world"].is_number_integer()) {
    return bad_input(fmt::format("{}: does not tell the world", manifest.string()));
  }
  mesh.world = json["world"];
  Result<std::string> jpeg = read_text_file(picture, kMostObjBytes);
  if (!jpeg) return jpeg.error();
  mesh.jpeg = *std::move(jpeg);
  const Result<std::string> text = read_text_file(obj, kMostObjBytes);
  if (!text) return text.error();
  ObjReader reader(&mesh);
  for (const TextLine& line : content_lines(*text)) {
    if (reader.take(line.text)) continue;
    return bad_input(
        fmt::format("{}:{}: '{}' is not what an export writes", obj.string(), line.number, shown(line.text)));
  }
  const size_t bytes = mesh.jpeg.size() + kBytesOfFace * mesh.faces.size() / 3;
  if (bytes <= kMostOfPage) return mesh;
  return bad_input(
      fmt::format("{}: {:.1f} MB are more than a page should carry; --texture-side of the export "
                  "makes the texture smaller",
                  folder.string(), static_cast<double>(bytes) / 1e6));
}

}  // namespace raysfm
