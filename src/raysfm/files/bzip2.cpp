#include "raysfm/files/bzip2.h"

#include <bzlib.h>
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <limits>
#include <new>

namespace raysfm {
namespace {

constexpr size_t kChunk = size_t{1} << 20;

// bzlib counts in 32 bits.
unsigned chunk_of(size_t bytes) {
  return static_cast<unsigned>(std::min<size_t>(bytes, size_t{1} << 30));
}

// bzlib takes input through a pointer to char that it never writes to.
char* input_pointer(std::string_view bytes) {
  return const_cast<char*>(bytes.data());
}

// Unpacks the stream at the beginning of `bytes` and takes it off them.
Result<void> decompress_stream(std::string_view* bytes, uintmax_t max_bytes, std::string* content) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) return internal_error("not enough memory to unpack it");
  Result<void> result;
  for (int state = BZ_OK; state != BZ_STREAM_END && result;) {
    const size_t before = content->size();
    // One byte more than allowed is enough to know.
    const size_t room = static_cast<size_t>(std::min<uintmax_t>(kChunk, max_bytes - before + 1));
    content->resize(before + room);
    const unsigned given = chunk_of(bytes->size());
    stream.next_in = input_pointer(*bytes);
    stream.avail_in = given;
    stream.next_out = content->data() + before;
    stream.avail_out = static_cast<unsigned>(room);
    state = BZ2_bzDecompress(&stream);
    bytes->remove_prefix(given - stream.avail_in);
    content->resize(before + room - stream.avail_out);
    if (state == BZ_MEM_ERROR) {
      result = internal_error("not enough memory to unpack it");
    } else if (state != BZ_OK && state != BZ_STREAM_END) {
      result = bad_input("damaged, bzip2 cannot unpack it");
    } else if (content->size() > max_bytes) {
      result = bad_input(fmt::format("unpacks to more than the {} bytes that are allowed", max_bytes));
    } else if (state == BZ_OK && bytes->empty() && content->size() == before) {
      result = bad_input("cut off, the end of the bzip2 data is missing");
    }
  }
  BZ2_bzDecompressEnd(&stream);
  return result;
}

}  // namespace

bool is_bzip2(std::string_view bytes) {
  return bytes.starts_with("BZh");
}

Result<std::string> decompress_bzip2(std::string_view bytes, uintmax_t max_bytes) {
  max_bytes = std::min<uintmax_t>(max_bytes, std::numeric_limits<uintmax_t>::max() - 1);
  std::string content;
  do {
    if (!is_bzip2(bytes)) return bad_input("damaged, what follows is no bzip2 data");
    if (auto r = decompress_stream(&bytes, max_bytes, &content); !r) return r.error();
  } while (!bytes.empty());
  return content;
}

std::string compress_bzip2(std::string_view content) {
  constexpr int kBlockSize = 9;  // in 100 kB, the best
  bz_stream stream{};
  int state = BZ2_bzCompressInit(&stream, kBlockSize, 0, 0);
  if (state == BZ_MEM_ERROR) throw std::bad_alloc();
  assert(state == BZ_OK);
  std::string bytes;
  do {
    const unsigned given = chunk_of(content.size());
    const bool last = given == content.size();
    const size_t before = bytes.size();
    bytes.resize(before + kChunk);
    stream.next_in = input_pointer(content);
    stream.avail_in = given;
    stream.next_out = bytes.data() + before;
    stream.avail_out = static_cast<unsigned>(kChunk);
    state = BZ2_bzCompress(&stream, last ? BZ_FINISH : BZ_RUN);
    content.remove_prefix(given - stream.avail_in);
    bytes.resize(before + kChunk - stream.avail_out);
  } while (state == BZ_RUN_OK || state == BZ_FINISH_OK);
  assert(state == BZ_STREAM_END);
  BZ2_bzCompressEnd(&stream);
  return bytes;
}

}  // namespace raysfm
