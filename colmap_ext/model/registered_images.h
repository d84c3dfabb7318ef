// The registered images of a colmap::Reconstruction in the order of their ids:
// that of its containers differs from run to run.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <algorithm>
#include <vector>

namespace dgsfm {

inline std::vector<colmap::image_t> SortedRegisteredImages(
    const colmap::Reconstruction& model) {
  std::vector<colmap::image_t> image_ids = model.RegImageIds();
  std::sort(image_ids.begin(), image_ids.end());
  return image_ids;
}

// False for images that the model does not have, too.
inline bool IsRegistered(const colmap::Reconstruction& model,
                         colmap::image_t image_id) {
  return model.ExistsImage(image_id) && model.IsImageRegistered(image_id);
}

}  // namespace dgsfm
