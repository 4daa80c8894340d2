#include "modules.h"

extern "C" const raysfm::app::DeviceModule raysfm_device_module = {raysfm::register_devices};
