#include "colmap_ext/formats/depth_file_formats.h"
#include "colmap_ext/formats/gray_picture.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

#include <boost/endian/conversion.hpp>
#include <png.h>

// libpng reports errors by longjmp, so each function that calls it through
// setjmp keeps every object with a destructor outside of itself.

namespace dgsfm::internal {
namespace {

// An image that libpng reads from the bytes of a file, or writes to them.
struct Session {
  enum class Mode { READ, WRITE };

  explicit Session(Mode session_mode, std::string file_bytes = "")
      : mode(session_mode), bytes(std::move(file_bytes)) {
    const auto create =
        mode == Mode::READ ? &png_create_read_struct : &png_create_write_struct;
    png = create(PNG_LIBPNG_VER_STRING, this, OnError, OnWarning);
    if (png != nullptr) info = png_create_info_struct(png);
    if (info == nullptr) throw std::bad_alloc();
  }
  ~Session() {
    if (mode == Mode::READ) {
      png_destroy_read_struct(&png, &info, nullptr);
    } else {
      png_destroy_write_struct(&png, &info);
    }
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  static void OnError(png_structp png, png_const_charp message) {
    static_cast<Session*>(png_get_error_ptr(png))->error = message;
    png_longjmp(png, 1);
  }
  static void OnWarning(png_structp, png_const_charp) {}
  [[noreturn]] void Fail() const { throw std::runtime_error("PNG: " + error); }

  const Mode mode;
  std::string bytes;
  size_t num_read = 0;
  std::string error;
  png_structp png = nullptr;
  png_infop info = nullptr;
};

void ReadBytes(png_structp png, png_bytep data, size_t size) {
  auto* session = static_cast<Session*>(png_get_io_ptr(png));
  if (size > session->bytes.size() - session->num_read) {
    png_error(png, "the file is truncated");
  }
  std::memcpy(data, session->bytes.data() + session->num_read, size);
  session->num_read += size;
}

bool ReadHeader(Session* session) {
  if (setjmp(png_jmpbuf(session->png))) return false;
  png_set_read_fn(session->png, session, ReadBytes);
  // Larger images are refused before libpng allocates their rows.
  png_set_user_limits(session->png, kMaxDepthMapSize, kMaxDepthMapSize);
  png_read_info(session->png, session->info);
  png_set_interlace_handling(session->png);
  return true;
}

// Palettes, 1 to 4 bits and transparency become 8 or 16 bits of grey or colour.
bool ExpandPicture(Session* session) {
  if (setjmp(png_jmpbuf(session->png))) return false;
  png_set_expand(session->png);
  png_set_strip_alpha(session->png);
  png_read_update_info(session->png, session->info);
  return true;
}

bool ReadRows(Session* session, png_bytepp rows) {
  if (setjmp(png_jmpbuf(session->png))) return false;
  png_read_image(session->png, rows);
  png_read_end(session->png, nullptr);
  return true;
}

// An exception must not pass through the C functions of libpng.
void WriteBytes(png_structp png, png_bytep data, size_t size) {
  auto* session = static_cast<Session*>(png_get_io_ptr(png));
  try {
    session->bytes.append(reinterpret_cast<const char*>(data), size);
  } catch (const std::bad_alloc&) {
    session->bytes.clear();
  }
  if (session->bytes.empty()) png_error(png, "out of memory");
}

bool WriteImage(Session* session, int width, int height, png_bytepp rows) {
  if (setjmp(png_jmpbuf(session->png))) return false;
  png_set_write_fn(session->png, session, WriteBytes, nullptr);
  png_set_IHDR(session->png,
               session->info,
               width,
               height,
               16,
               PNG_COLOR_TYPE_GRAY,
               PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_write_info(session->png, session->info);
  png_write_image(session->png, rows);
  png_write_end(session->png, nullptr);
  return true;
}

std::vector<png_bytep> FindRows(std::vector<uint8_t>* pixels, int height) {
  std::vector<png_bytep> rows(height);
  for (int y = 0; y < height; ++y) {
    rows[y] = pixels->data() + y * (pixels->size() / height);
  }
  return rows;
}

}  // namespace

DepthGrid ParsePng(std::string bytes, int bit_depth) {
  Session session(Session::Mode::READ, std::move(bytes));
  if (!ReadHeader(&session)) session.Fail();
  const int file_bit_depth = png_get_bit_depth(session.png, session.info);
  const int color_type = png_get_color_type(session.png, session.info);
  if (file_bit_depth != bit_depth || color_type != PNG_COLOR_TYPE_GRAY) {
    throw std::runtime_error(
        "PNG of " + std::to_string(file_bit_depth) + " bits and " +
        std::to_string(png_get_channels(session.png, session.info)) +
        " channels; " + std::to_string(bit_depth) +
        " bits and one channel are needed" +
        (bit_depth == 16
             ? "; pictures of relative depth are read with --depth_type "
               "relative_disparity or relative_depth"
             : ""));
  }
  DepthGrid grid;
  grid.width = png_get_image_width(session.png, session.info);
  grid.height = png_get_image_height(session.png, session.info);
  CheckGridSize(grid.width, grid.height);
  const size_t value_size = bit_depth / 8;
  const size_t num_bytes = value_size * grid.width * grid.height;
  // Checks what a few bytes announce before memory is allocated for it.
  CheckExpansion(num_bytes, session.bytes.size());
  std::vector<uint8_t> pixels(num_bytes);
  std::vector<png_bytep> rows = FindRows(&pixels, grid.height);
  if (!ReadRows(&session, rows.data())) {
    session.Fail();
  }
  grid.values.reserve(num_bytes / value_size);
  for (size_t i = 0; i < num_bytes; i += value_size) {
    grid.values.push_back(
        value_size == 1 ? pixels[i] : boost::endian::load_big_u16(&pixels[i]));
  }
  return grid;
}

GrayPicture ParseGrayPicture(std::string bytes) {
  Session session(Session::Mode::READ, std::move(bytes));
  if (!ReadHeader(&session) || !ExpandPicture(&session)) session.Fail();
  GrayPicture picture;
  DepthGrid& grid = picture.grid;
  grid.width = png_get_image_width(session.png, session.info);
  grid.height = png_get_image_height(session.png, session.info);
  CheckGridSize(grid.width, grid.height);
  const size_t num_channels = png_get_channels(session.png, session.info);
  const size_t value_size = png_get_bit_depth(session.png, session.info) / 8;
  picture.max_value = value_size == 1 ? 255 : 65535;
  const size_t num_values = size_t(grid.width) * grid.height;
  const size_t num_bytes = value_size * num_channels * num_values;
  // A pixel takes at least one bit.
  CheckExpansion(num_values / 8, session.bytes.size());
  std::vector<uint8_t> pixels(num_bytes);
  std::vector<png_bytep> rows = FindRows(&pixels, grid.height);
  if (!ReadRows(&session, rows.data())) session.Fail();
  grid.values.reserve(num_values);
  const auto value_at = [&](size_t i) -> int {
    const uint8_t* value = &pixels[i * value_size];
    return value_size == 1 ? *value : boost::endian::load_big_u16(value);
  };
  for (size_t i = 0; i < num_values; ++i) {
    const int value = value_at(i * num_channels);
    for (size_t channel = 1; channel < num_channels; ++channel) {
      if (value_at(i * num_channels + channel) == value) continue;
      throw std::runtime_error(
          "a PNG in colours, as of colour-mapped depth, which numbers cannot "
          "be read from: let the depth model write grey pictures, or better "
          "its numbers (.npy)");
    }
    grid.values.push_back(static_cast<float>(value));
  }
  return picture;
}

std::string FormatPng16(int width,
                        int height,
                        const std::vector<uint16_t>& values) {
  std::vector<uint8_t> pixels(2 * values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    boost::endian::store_big_u16(&pixels[2 * i], values[i]);
  }
  std::vector<png_bytep> rows = FindRows(&pixels, height);
  Session session(Session::Mode::WRITE);
  if (!WriteImage(&session, width, height, rows.data())) {
    session.Fail();
  }
  return std::move(session.bytes);
}

}  // namespace dgsfm::internal
