#include "support/shared_data.h"

#include <cstdlib>

namespace raysfm::testing_support {

std::filesystem::path shared_data(const std::filesystem::path& relative) {
  const char* from_environment = std::getenv("RAYSFM_SHARED_DATA");
  return std::filesystem::path(from_environment ? from_environment : RAYSFM_SHARED_DATA_DEFAULT) / relative;
}

}  // namespace raysfm::testing_support
