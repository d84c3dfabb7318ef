#include "colmap_ext/formats/picture_file.h"

#include "colmap_ext/output_file.h"

#include <memory>
#include <stdexcept>

namespace dgsfm {

void WritePicture(const std::string& path, const colmap::Bitmap& bitmap) {
  FREE_IMAGE_FORMAT format = FreeImage_GetFIFFromFilename(path.c_str());
  if (format == FIF_UNKNOWN) format = FIF_PNG;
  const std::unique_ptr<FIMEMORY, decltype(&FreeImage_CloseMemory)> memory(
      FreeImage_OpenMemory(), &FreeImage_CloseMemory);
  BYTE* bytes = nullptr;
  DWORD num_bytes = 0;
  // FreeImage does not write to what it takes without const.
  if (!FreeImage_SaveToMemory(format,
                              const_cast<FIBITMAP*>(bitmap.Data()),
                              memory.get(),
                              format == FIF_JPEG ? JPEG_QUALITYSUPERB : 0) ||
      !FreeImage_AcquireMemory(memory.get(), &bytes, &num_bytes)) {
    throw std::runtime_error("cannot write " + path +
                             ": no picture of this format can be made of it");
  }
  WriteFile(path, {reinterpret_cast<const char*>(bytes), num_bytes});
}

}  // namespace dgsfm
