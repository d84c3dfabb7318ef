#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>

#include <Eigen/Core>
#include <tiffio.h>

namespace dgsfm::internal {
namespace {

// Keeps the first message of libtiff.
int OnError(TIFF*,
            void* user_data,
            const char*,
            const char* format,
            va_list arguments) {
  auto* error = static_cast<std::string*>(user_data);
  if (error->empty()) {
    char text[256];
    std::vsnprintf(text, sizeof(text), format, arguments);
    *error = text;
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

std::unique_ptr<TIFF, Closer> Open(const std::string& path,
                                   std::string* error) {
  const std::unique_ptr<TIFFOpenOptions, Closer> options(
      TIFFOpenOptionsAlloc());
  if (options == nullptr) throw std::bad_alloc();
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kMaxFileBytes);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), OnError, error);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), OnWarning, nullptr);
  // Without memory mapping ("m"): a file that shrinks would end the program.
  return std::unique_ptr<TIFF, Closer>(
      TIFFOpenExt(path.c_str(), "rm", options.get()));
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
  // Tags that are missing keep these values, the defaults of the standard.
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
  // Whether writers of such files mean it is unclear, so no guess is made.
  if (orientation != ORIENTATION_TOPLEFT) {
    throw std::runtime_error("TIFF with its own orientation " +
                             std::to_string(orientation));
  }
  return layout;
}

// libtiff has turned the bytes into the machine's order.
float LoadValue(const Layout& layout, const uint8_t* data) {
  if (layout.is_float) {
    if (layout.value_size == 2) return LoadNumber<Eigen::half>(data);
    return layout.value_size == 4 ? LoadNumber<float>(data)
                                  : LoadNumber<double>(data);
  }
  if (layout.value_size == 1) return *data;
  return layout.value_size == 2 ? LoadNumber<uint16_t>(data)
                                : LoadNumber<uint32_t>(data);
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

// A file has tiles or, as tiles of the width of the image, strips.
void ReadBlocks(TIFF* tiff, const Layout& layout, DepthGrid* grid) {
  const bool is_tiled = TIFFIsTiled(tiff);
  uint32_t width = layout.width;
  uint32_t height = layout.height;
  if (is_tiled) {
    TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &width);
    TIFFGetField(tiff, TIFFTAG_TILELENGTH, &height);
  } else {
    TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &height);
    height = std::min(height, layout.height);
  }
  CheckGridSize(width, height);
  std::vector<uint8_t> block(size_t(width) * height * layout.value_size);
  for (uint32_t y = 0; y < layout.height; y += height) {
    const uint32_t num_rows =
        is_tiled ? height : std::min(height, layout.height - y);
    const auto num_bytes =
        static_cast<tmsize_t>(size_t(num_rows) * width * layout.value_size);
    for (uint32_t x = 0; x < layout.width; x += width) {
      const tmsize_t num_read =
          is_tiled ? TIFFReadEncodedTile(tiff,
                                         TIFFComputeTile(tiff, x, y, 0, 0),
                                         block.data(),
                                         num_bytes)
                   : TIFFReadEncodedStrip(tiff,
                                          TIFFComputeStrip(tiff, y, 0),
                                          block.data(),
                                          num_bytes);
      // A short block would leave rows at the numbers of the block before.
      if (num_read != num_bytes) throw std::runtime_error("damaged");
      CopyBlock(layout, block, width, x, y, num_rows, grid);
    }
  }
}

}  // namespace

DepthGrid ReadTiff(const std::string& path) {
  std::string error;
  const auto tiff = Open(path, &error);
  if (tiff == nullptr) throw std::runtime_error("TIFF: " + error);
  const Layout layout = ReadLayout(tiff.get());
  CheckExpansion(layout.value_size * uint64_t(layout.width) * layout.height,
                 std::filesystem::file_size(path));
  DepthGrid grid = {static_cast<int>(layout.width),
                    static_cast<int>(layout.height),
                    std::vector<float>(size_t(layout.width) * layout.height)};
  try {
    ReadBlocks(tiff.get(), layout, &grid);
  } catch (const std::runtime_error& failure) {
    throw std::runtime_error(std::string("TIFF: ") + failure.what() + "; " +
                             error);
  }
  return grid;
}

}  // namespace dgsfm::internal
