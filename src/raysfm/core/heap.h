#pragma once

namespace raysfm {

// Sets up the heap of the process for tracking; for programs, before they begin and have threads. Without it
// all works, with more memory and a tenth to a half slower. The heap grows within one piece of addresses that
// asks for large pages: to bring in the pages of an image one by one takes as long as to decode it. All
// threads share it, so that one takes what another frees. Where there are no such addresses or pages, it
// grows as ever.
void prepare_heap();

// Gives what was freed back to the system, where it lies in whole pages.
void return_freed_memory();

}  // namespace raysfm
