#include "atlas/zstd_blob.h"

#include <zstd.h>

#include <memory>

namespace portolan {
namespace {

/// Descriptors, nine tenths of the bytes, are next to random: more effort gains little.
constexpr int kLevel = 1;

}  // namespace

std::string Compress(std::string_view bytes) {
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(), &ZSTD_freeCCtx);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kLevel);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  std::string frame(ZSTD_compressBound(bytes.size()), '\0');
  const size_t size = ZSTD_compress2(context.get(), frame.data(), frame.size(), bytes.data(), bytes.size());
  PORTOLAN_CHECK(ZSTD_isError(size) == 0) << ZSTD_getErrorName(size);
  frame.resize(size);
  return frame;
}

Result<std::string> Decompress(std::string_view frame, size_t most) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(), &ZSTD_freeDCtx);
  ZSTD_inBuffer in{frame.data(), frame.size(), 0};
  std::string piece(ZSTD_DStreamOutSize(), '\0'), bytes;
  for (;;) {  // in pieces: the size that a damaged frame claims may be anything
    ZSTD_outBuffer out{piece.data(), piece.size(), 0};
    const size_t left = ZSTD_decompressStream(context.get(), &out, &in);
    if (ZSTD_isError(left) != 0) return Error{std::string("damaged (") + ZSTD_getErrorName(left) + ")"};
    bytes.append(piece, 0, out.pos);
    if (bytes.size() > most) return Error{"larger than " + std::to_string(most) + " bytes"};
    if (left == 0) break;
    if (in.pos == in.size && out.pos < out.size) return Error{"cut short"};
  }
  if (in.pos != in.size) return Error{std::to_string(in.size - in.pos) + " bytes too many"};
  return bytes;
}

}  // namespace portolan
