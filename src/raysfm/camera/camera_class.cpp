#include "raysfm/camera/camera_class.h"
namespace raysfm {
std::string_view to_string(CameraClass c) {
  switch (c) {
    case CameraClass::kCentral:
      return "central";
    case CameraClass::kAxial:
      return "axial";
    case CameraClass::kNonAxial:
      return "non-axial";
    case CameraClass::kNonCentral:
      return "non-central";
  }
  return "unknown";
}
}  // namespace raysfm
