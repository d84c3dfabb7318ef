#include "controllers/report/thumbnails.h"

#include "colmap_ext/formats/image_header.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <glog/logging.h>

namespace dgsfm {
namespace {

constexpr double kMinSize = 48;         // longer side [px]
constexpr double kMaxSize = 320;        // longer side [px]
constexpr double kBytesPerPixel = 0.3;  // of a detailed picture
constexpr int kQuality = 70;

// JPEGs are decoded at the smallest size that is large enough.
ImageFile ReadSmall(const std::string& path, int size) {
  int flags = 0;
  if (FreeImage_GetFileType(path.c_str()) == FIF_JPEG) {
    flags = (2 * size) << 16 | JPEG_FAST;
  }
  return ReadImageFile(path, flags);
}

// Without EXIF data, by which browsers turn pictures, and colour profiles.
void DropMetadata(FIBITMAP* bitmap) {
  for (int model = FIMD_COMMENTS; model <= FIMD_EXIF_RAW; ++model) {
    FreeImage_SetMetadata(FREE_IMAGE_MDMODEL(model), bitmap, nullptr, nullptr);
  }
  FreeImage_DestroyICCProfile(bitmap);
}

std::string EncodeJpeg(FIBITMAP* bitmap) {
  const std::unique_ptr<FIMEMORY, decltype(&FreeImage_CloseMemory)> memory(
      FreeImage_OpenMemory(), &FreeImage_CloseMemory);
  BYTE* bytes = nullptr;
  DWORD num_bytes = 0;
  if (!FreeImage_SaveToMemory(
          FIF_JPEG,
          bitmap,
          memory.get(),
          kQuality | JPEG_OPTIMIZE | JPEG_SUBSAMPLING_420) ||
      !FreeImage_AcquireMemory(memory.get(), &bytes, &num_bytes)) {
    return "";
  }
  return std::string(reinterpret_cast<const char*>(bytes), num_bytes);
}

// Throws std::runtime_error naming the file.
std::string MakeThumbnail(const std::string& path, int size) {
  const ImageFile image = ReadSmall(path, size);
  const ImageFile rgb(FreeImage_ConvertTo24Bits(image.get()),
                      &FreeImage_Unload);
  if (!rgb) throw std::runtime_error("no colours in image " + path);
  const ImageFile small(
      FreeImage_MakeThumbnail(rgb.get(), size, /*convert=*/TRUE),
      &FreeImage_Unload);
  if (!small) throw std::runtime_error("cannot scale image " + path);
  DropMetadata(small.get());
  return EncodeJpeg(small.get());
}

}  // namespace

std::vector<std::string> MakeThumbnails(const std::string& image_path,
                                        const std::vector<std::string>& names,
                                        size_t max_num_bytes,
                                        int num_threads) {
  const double bytes_per_image = double(max_num_bytes) / (names.size() + 1);
  // A little less than what fits, of images with an aspect ratio of 4 : 3.
  const int size = std::clamp(
      std::sqrt(bytes_per_image / kBytesPerPixel * 4 / 3), kMinSize, kMaxSize);
  std::vector<std::string> thumbnails(names.size());
  std::vector<std::string> errors(names.size());
  Progress progress("Pictures of the report", names.size());
  ParallelFor(names.size(), num_threads, [&](size_t i) {
    try {
      thumbnails[i] = MakeThumbnail(PathInside(image_path, names[i]), size);
    } catch (const std::runtime_error& error) {
      errors[i] = error.what();
    }
    progress.Step();
  });
  size_t num_missing = 0;
  std::string reason;
  size_t num_bytes = 0;
  for (size_t i = 0; i < names.size(); ++i) {
    if (errors[i].empty() && num_bytes + thumbnails[i].size() > max_num_bytes) {
      errors[i] = names[i] + " is beyond what a page may hold";
      thumbnails[i].clear();
    }
    num_bytes += thumbnails[i].size();
    if (errors[i].empty()) continue;
    if (num_missing++ == 0) reason = errors[i];
  }
  if (num_missing > 0) {
    LOG(WARNING) << num_missing << " images have no thumbnail: " << reason;
  }
  return thumbnails;
}

}  // namespace dgsfm
