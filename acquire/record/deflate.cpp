// SPDX-License-Identifier: MIT
#include "acquire/record/deflate.hpp"

#include <libdeflate.h>

#include <map>
#include <memory>

namespace echofuse::record {

Bytes deflated(ByteView data, int level) {
  using Compressor =
      std::unique_ptr<libdeflate_compressor,
                      decltype([](libdeflate_compressor* c) { libdeflate_free_compressor(c); })>;
  thread_local std::map<int, Compressor> compressors;
  Compressor& compressor = compressors[level];
  if (!compressor) compressor.reset(libdeflate_alloc_compressor(level));
  if (!compressor) return {};
  Bytes out(libdeflate_zlib_compress_bound(compressor.get(), data.size()));
  out.resize(
      libdeflate_zlib_compress(compressor.get(), data.data(), data.size(), out.data(), out.size()));
  return out;
}

bool inflate(ByteView data, std::span<std::uint8_t> out) {
  using Decompressor =
      std::unique_ptr<libdeflate_decompressor, decltype([](libdeflate_decompressor* d) {
                        libdeflate_free_decompressor(d);
                      })>;
  thread_local const Decompressor decompressor(libdeflate_alloc_decompressor());
  return decompressor &&
         libdeflate_zlib_decompress(decompressor.get(), data.data(), data.size(), out.data(),
                                    out.size(), nullptr) == LIBDEFLATE_SUCCESS;
}

}  // namespace echofuse::record
