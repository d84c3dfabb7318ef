#include "controllers/image_names.h"

#include <algorithm>
#include <filesystem>
#include <set>

namespace dgsfm {

std::map<std::string, colmap::image_t> ImageIdsByName(const Scene& scene) {
  std::map<std::string, colmap::image_t> image_ids;
  for (const auto& [image_id, image] : scene.images) {
    std::string flat_name = image.Name();
    std::replace(flat_name.begin(), flat_name.end(), '/', '-');
    const std::set<std::string> aliases = {
        flat_name, std::filesystem::path(image.Name()).filename()};
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
