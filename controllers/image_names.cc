#include "controllers/image_names.h"

#include <algorithm>
#include <filesystem>
#include <set>

namespace dgsfm {

std::map<std::string, colmap::image_t> ImageIdsByName(const Scene& scene,
                                                      bool with_flat_names) {
  std::map<std::string, colmap::image_t> image_ids;
  for (const auto& [image_id, image] : scene.images) {
    std::string flat_name = image.Name();
    std::replace(flat_name.begin(), flat_name.end(), '/', '-');
    // A set, because both are the same for images without a folder.
    std::set<std::string> aliases = {
        std::filesystem::path(image.Name()).filename()};
    if (with_flat_names) aliases.insert(flat_name);
    for (const std::string& alias : aliases) {
      const auto [it, is_new] = image_ids.emplace(alias, image_id);
      if (!is_new) it->second = colmap::kInvalidImageId;
    }
  }
  for (const auto& [image_id, image] : scene.images) {
    image_ids[image.Name()] = image_id;
  }
  return image_ids;
}

}  // namespace dgsfm
