#include "raysfm/page/page_template.h"

#ifdef RAYSFM_PAGE_FILE
asm(".pushsection .rodata\n"
    ".hidden raysfm_page_begin\n.global raysfm_page_begin\nraysfm_page_begin:\n"
    ".incbin \"" RAYSFM_PAGE_FILE
    "\"\n"
    ".hidden raysfm_page_end\n.global raysfm_page_end\nraysfm_page_end:\n"
    ".byte 0\n"
    ".popsection\n");
extern "C" __attribute__((visibility("hidden"))) const char raysfm_page_begin[];
extern "C" __attribute__((visibility("hidden"))) const char raysfm_page_end[];
#endif

namespace raysfm {

std::string_view page_template() {
#ifdef RAYSFM_PAGE_FILE
  return {raysfm_page_begin, static_cast<size_t>(raysfm_page_end - raysfm_page_begin)};
#else
  return {};
#endif
}

}  // namespace raysfm
