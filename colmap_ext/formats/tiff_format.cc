#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>

#include <Eigen/Core>
#include <tiffio.h>

namespace dgsfm::internal {
namespace {

// The file in memory and the first message of libtiff.
struct Source {
  const std::vector<uint8_t>& bytes;
  size_t pos = 0;
  std::string error;
};

Source* SourceOf(thandle_t handle) { return static_cast<Source*>(handle); }

tmsize_t ReadBytes(thandle_t handle, void* data, tmsize_t size) {
  Source* source = SourceOf(handle);
  const size_t left =
      source->bytes.size() - std::min(source->pos, source->bytes.size());
  const size_t num_read = std::min(left, static_cast<size_t>(size));
  if (num_read == 0) return 0;
  std::memcpy(data, source->bytes.data() + source->pos, num_read);
  source->pos += num_read;
  return static_cast<tmsize_t>(num_read);
}

tmsize_t RefuseToWrite(thandle_t, void*, tmsize_t) { return 0; }

toff_t Seek(thandle_t handle, toff_t offset, int whence) {
  Source* source = SourceOf(handle);
  const size_t base = whence == SEEK_SET   ? 0
                      : whence == SEEK_CUR ? source->pos
                                           : source->bytes.size();
  return source->pos = base + offset;
}

toff_t Size(thandle_t handle) { return SourceOf(handle)->bytes.size(); }

int OnError(TIFF*,
            void* user_data,
            const char*,
            const char* format,
            va_list arguments) {
  auto* source = static_cast<Source*>(user_data);
  if (source->error.empty()) {
    char text[256];
    std::vsnprintf(text, sizeof(text), format, arguments);
    source->error = text;
  }
  return 1;
}

int OnWarning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

struct Closer {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
  void operator()(TIFFOpenOptions* options) const {
    TIFFOpenOptionsFree(options);
  }
};
using Tiff = std::unique_ptr<TIFF, Closer>;

Tiff Open(Source* source) {
  const std::unique_ptr<TIFFOpenOptions, Closer> options(
      TIFFOpenOptionsAlloc());
  if (options == nullptr) throw std::bad_alloc();
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kMaxFileBytes);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), OnError, source);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), OnWarning, nullptr);
  // Without memory mapping ("m").
  return Tiff(TIFFClientOpenExt(
      "memory",
      "rm",
      source,
      ReadBytes,
      RefuseToWrite,
      Seek,
      [](thandle_t) { return 0; },
      Size,
      nullptr,
      nullptr,
      options.get()));
}

struct Layout {
  uint32_t width = 0;
  uint32_t height = 0;
  size_t value_size = 0;
  bool is_float = false;
};

Layout ReadLayout(TIFF* tiff) {
  uint16_t bits = 1;
  uint16_t num_samples = 1;
  uint16_t format = SAMPLEFORMAT_UINT;
  uint16_t orientation = ORIENTATION_TOPLEFT;
  Layout layout;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &layout.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &layout.height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &num_samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ORIENTATION, &orientation);
  CheckGridSize(layout.width, layout.height);
  layout.value_size = bits / 8;
  layout.is_float = format == SAMPLEFORMAT_IEEEFP;
  const bool is_known =
      layout.is_float
          ? bits == 16 || bits == 32 || bits == 64
          : (format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_VOID) &&
                (bits == 8 || bits == 16 || bits == 32);
  if (!is_known || num_samples != 1) {
    throw std::runtime_error(
        "TIFF of " + std::to_string(num_samples) + " samples of " +
        std::to_string(bits) + " bits and format " + std::to_string(format) +
        "; depth needs one, a float or an integer without sign");
  }
  if (orientation != ORIENTATION_TOPLEFT) {
    throw std::runtime_error("TIFF with its own orientation " +
                             std::to_string(orientation));
  }
  return layout;
}

template <typename T>
float Load(const uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(T));
  return static_cast<float>(value);
}

// libtiff has turned the bytes into the machine's order.
float LoadValue(const Layout& layout, const uint8_t* data) {
  if (layout.is_float) {
    if (layout.value_size == 2) return Load<Eigen::half>(data);
    return layout.value_size == 4 ? Load<float>(data) : Load<double>(data);
  }
  if (layout.value_size == 1) return *data;
  return layout.value_size == 2 ? Load<uint16_t>(data) : Load<uint32_t>(data);
}

// Copies a block whose rows have block_width values, cut at the grid's border.
void CopyBlock(const Layout& layout,
               const std::vector<uint8_t>& block,
               uint32_t block_width,
               uint32_t x0,
               uint32_t y0,
               uint32_t num_rows,
               DepthGrid* grid) {
  const uint32_t num_cols = std::min(block_width, layout.width - x0);
  num_rows = std::min(num_rows, layout.height - y0);
  for (uint32_t y = 0; y < num_rows; ++y) {
    const uint8_t* row =
        block.data() + size_t(y) * block_width * layout.value_size;
    for (uint32_t x = 0; x < num_cols; ++x) {
      grid->values[size_t(y0 + y) * layout.width + x0 + x] =
          LoadValue(layout, row + x * layout.value_size);
    }
  }
}

bool ReadTiles(TIFF* tiff, const Layout& layout, DepthGrid* grid) {
  uint32_t tile_width = 0;
  uint32_t tile_height = 0;
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width);
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height);
  CheckGridSize(tile_width, tile_height);
  std::vector<uint8_t> tile(size_t(tile_width) * tile_height *
                            layout.value_size);
  if (TIFFTileSize(tiff) != static_cast<tmsize_t>(tile.size())) return false;
  for (uint32_t y = 0; y < layout.height; y += tile_height) {
    for (uint32_t x = 0; x < layout.width; x += tile_width) {
      if (TIFFReadTile(tiff, tile.data(), x, y, 0, 0) < 0) return false;
      CopyBlock(layout, tile, tile_width, x, y, tile_height, grid);
    }
  }
  return true;
}

bool ReadStrips(TIFF* tiff, const Layout& layout, DepthGrid* grid) {
  uint32_t strip_height = layout.height;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &strip_height);
  strip_height = std::min(strip_height, layout.height);
  if (strip_height == 0) return false;
  std::vector<uint8_t> strip(size_t(strip_height) * layout.width *
                             layout.value_size);
  for (uint32_t y = 0; y < layout.height; y += strip_height) {
    const uint32_t num_rows = std::min(strip_height, layout.height - y);
    const auto num_bytes = static_cast<tmsize_t>(
        size_t(num_rows) * layout.width * layout.value_size);
    if (TIFFReadEncodedStrip(
            tiff, TIFFComputeStrip(tiff, y, 0), strip.data(), num_bytes) !=
        num_bytes) {
      return false;
    }
    CopyBlock(layout, strip, layout.width, 0, y, num_rows, grid);
  }
  return true;
}

}  // namespace

DepthGrid ParseTiff(const std::vector<uint8_t>& bytes) {
  Source source = {bytes, 0, ""};
  const Tiff tiff = Open(&source);
  if (tiff == nullptr) throw std::runtime_error("TIFF: " + source.error);
  const Layout layout = ReadLayout(tiff.get());
  CheckExpansion(layout.value_size * uint64_t(layout.width) * layout.height,
                 bytes.size());
  DepthGrid grid = {static_cast<int>(layout.width),
                    static_cast<int>(layout.height),
                    std::vector<float>(size_t(layout.width) * layout.height)};
  const bool is_read = TIFFIsTiled(tiff.get())
                           ? ReadTiles(tiff.get(), layout, &grid)
                           : ReadStrips(tiff.get(), layout, &grid);
  if (!is_read) throw std::runtime_error("TIFF: damaged; " + source.error);
  return grid;
}

}  // namespace dgsfm::internal
