#include "colmap_ext/depth_file_formats.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>
#include <stdexcept>

#include <boost/endian/conversion.hpp>
#include <zip.h>

namespace dgsfm::internal {
namespace {

struct ZipCloser {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};

std::unique_ptr<zip_t, ZipCloser> OpenArchive(const std::string& path) {
  int code = 0;
  std::unique_ptr<zip_t, ZipCloser> archive(
      zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (archive == nullptr) {
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    const std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    throw std::runtime_error("no NumPy archive: " + reason);
  }
  return archive;
}

// The next token of a PFM header, which ends at white space.
std::string NextToken(const std::vector<uint8_t>& bytes, size_t* pos) {
  constexpr size_t kMaxTokenSize = 32;
  while (*pos < bytes.size() && std::isspace(bytes[*pos])) ++*pos;
  std::string token;
  while (*pos < bytes.size() && !std::isspace(bytes[*pos]) &&
         token.size() < kMaxTokenSize) {
    token.push_back(static_cast<char>(bytes[(*pos)++]));
  }
  return token;
}

uint64_t ParseCount(const std::string& token) {
  if (token.empty() || token.size() > 9 ||
      !std::all_of(token.begin(), token.end(), [](unsigned char c) {
        return std::isdigit(c);
      })) {
    throw std::runtime_error("PFM header with the size '" + token + "'");
  }
  return std::stoull(token);
}

// Whether the data are little endian, by the sign of the scale.
bool ParseByteOrder(const std::string& token) {
  char* end = nullptr;
  const double scale = std::strtod(token.c_str(), &end);
  if (token.empty() || *end != '\0' || !std::isfinite(scale) || scale == 0) {
    throw std::runtime_error("PFM header with the scale '" + token + "'");
  }
  return scale < 0;
}

}  // namespace

void CheckGridSize(uint64_t width, uint64_t height) {
  if (width >= 1 && height >= 1 && width <= kMaxDepthMapSize &&
      height <= kMaxDepthMapSize) {
    return;
  }
  throw std::runtime_error("a size of " + std::to_string(width) + " x " +
                           std::to_string(height) + " is not in 1 to " +
                           std::to_string(kMaxDepthMapSize));
}

std::optional<DepthGrid> ReadNpz(const std::string& path,
                                 const std::string& array_name) {
  const std::string array = "the array " + array_name;
  const auto archive = OpenArchive(path);
  zip_stat_t stat;
  zip_stat_init(&stat);
  if (zip_stat(archive.get(), (array_name + ".npy").c_str(), 0, &stat) != 0) {
    return std::nullopt;
  }
  constexpr zip_uint64_t kNeeded =
      ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
  if ((stat.valid & kNeeded) != kNeeded ||
      (stat.comp_method != ZIP_CM_STORE &&
       stat.comp_method != ZIP_CM_DEFLATE)) {
    throw std::runtime_error(array + " is neither stored nor deflated");
  }
  if (stat.size > kMaxFileBytes ||
      stat.size / kMaxDeflateRatio > stat.comp_size) {
    throw std::runtime_error(array + " has an impossible size of " +
                             std::to_string(stat.size) + " bytes");
  }
  const std::unique_ptr<zip_file_t, ZipCloser> file(
      zip_fopen_index(archive.get(), stat.index, 0));
  if (file == nullptr) {
    throw std::runtime_error(array + ": " + zip_strerror(archive.get()));
  }
  std::vector<uint8_t> bytes(stat.size);
  const zip_int64_t num_read =
      zip_fread(file.get(), bytes.data(), bytes.size());
  // Reading on past the end makes libzip compare the checksum.
  uint8_t extra = 0;
  if (num_read < 0 || zip_fread(file.get(), &extra, 1) != 0 ||
      static_cast<uint64_t>(num_read) != stat.size) {
    throw std::runtime_error(array +
                             " is damaged: " + zip_file_strerror(file.get()));
  }
  return ParseNpy(bytes);
}

DepthGrid ParsePfm(const std::vector<uint8_t>& bytes) {
  size_t pos = 0;
  const std::string magic = NextToken(bytes, &pos);
  if (magic == "PF") {
    throw std::runtime_error("PFM of three channels; depth needs one");
  }
  if (magic != "Pf") throw std::runtime_error("not a PFM file");
  const uint64_t width = ParseCount(NextToken(bytes, &pos));
  const uint64_t height = ParseCount(NextToken(bytes, &pos));
  const bool is_little_endian = ParseByteOrder(NextToken(bytes, &pos));
  CheckGridSize(width, height);
  // A single white space separates header and data.
  const size_t data_size = bytes.size() - std::min(pos + 1, bytes.size());
  if (data_size != 4 * width * height) {
    throw std::runtime_error(
        std::to_string(data_size) + " bytes of data instead of the " +
        std::to_string(4 * width * height) + " of " + std::to_string(width) +
        " x " + std::to_string(height) + " values");
  }
  DepthGrid grid = {static_cast<int>(width), static_cast<int>(height), {}};
  grid.values.resize(width * height);
  const uint8_t* data = bytes.data() + pos + 1;
  for (size_t y = height; y-- > 0;) {  // the file begins at the bottom
    for (size_t x = 0; x < width; ++x, data += 4) {
      using namespace boost::endian;
      grid.values[y * width + x] =
          is_little_endian ? endian_load<float, 4, order::little>(data)
                           : endian_load<float, 4, order::big>(data);
    }
  }
  return grid;
}

}  // namespace dgsfm::internal
