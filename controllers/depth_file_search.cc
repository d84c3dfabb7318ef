#include "controllers/depth_file_search.h"

#include "colmap_ext/formats/hdf5_format.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <stdexcept>

#include <glog/logging.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr char kGeometric[] = ".geometric";
constexpr char kPhotometric[] = ".photometric";

// Files, relative to a folder and with '/', by what an image with that depth
// may be called.
using FilesByName = std::map<std::string, std::vector<std::string>>;

// What the image is called whose file this is.
std::string ImageName(const fs::path& file) {
  fs::path name = fs::path(file).replace_extension();
  if (file.extension() == ".bin" &&
      (name.extension() == kGeometric || name.extension() == kPhotometric)) {
    name.replace_extension();
  }
  return name.generic_string();
}

// Dense stereo writes photometric maps first, and geometric ones from them.
bool HasBetterVersion(const fs::path& file) {
  const fs::path name = fs::path(file).replace_extension();
  return file.extension() == ".bin" && name.extension() == kPhotometric &&
         fs::exists(fs::path(name).replace_extension().string() + kGeometric +
                    ".bin");
}

// Links to nothing count, so that reading them fails with the reason.
bool IsFile(const fs::directory_entry& entry) {
  return entry.is_regular_file() || (entry.is_symlink() && !entry.exists());
}

// Links to folders are followed, as large data sets are often linked in.
FilesByName ListFolder(const std::string& folder) try {
  const std::vector<std::string>& extensions = DepthFileExtensions();
  FilesByName files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(
           folder, fs::directory_options::follow_directory_symlink)) {
    const fs::path file = entry.path().lexically_relative(folder);
    if (!IsFile(entry) ||
        std::find(extensions.begin(),
                  extensions.end(),
                  internal::LowerExtension(file)) == extensions.end() ||
        HasBetterVersion(entry.path())) {
      continue;
    }
    files[ImageName(file)].push_back(file.generic_string());
  }
  for (auto& [name, same_name_files] : files) {
    std::sort(same_name_files.begin(), same_name_files.end());
  }
  return files;
} catch (const fs::filesystem_error& error) {
  // The path of links in a circle is long and of no use.
  const bool is_circle =
      error.code() == std::errc::too_many_symbolic_link_levels;
  throw std::runtime_error(
      "cannot search " +
      (is_circle || error.path1().empty() ? folder : error.path1().string()) +
      ": " + error.code().message());
}

FilesByName ListHdf5(const std::string& path) {
  try {
    const internal::Hdf5File file(path);
    FilesByName groups;
    for (const char* array : {"depth", "points"}) {
      for (const std::string& group : file.FindGroups(array)) {
        groups[group] = {group};
      }
    }
    return groups;
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
}

// File of each image that has one.
std::map<colmap::image_t, std::string> MatchFilesToImages(
    const Scene& scene, const FilesByName& files, bool use_base_names) {
  std::map<colmap::image_t, std::string> file_of_image;
  std::map<std::string, std::string> image_of_file;
  for (const auto& [image_id, image] : scene.images) {
    const std::string& name = image.Name();
    std::set<std::string> keys = {
        name, fs::path(name).replace_extension().generic_string()};
    if (use_base_names) keys.insert(fs::path(name).filename().string());
    std::vector<std::string> matches;
    for (const std::string& key : keys) {
      const auto match = files.find(key);
      if (match == files.end()) continue;
      matches.insert(matches.end(), match->second.begin(), match->second.end());
    }
    if (matches.empty()) continue;
    // Which of the two is meant only the user can tell.
    if (matches.size() > 1) {
      throw std::runtime_error("image " + name + " has two depth maps, " +
                               matches[0] + " and " + matches[1]);
    }
    const auto [other, is_new] = image_of_file.emplace(matches[0], name);
    if (!is_new) {
      throw std::runtime_error("depth map " + matches[0] +
                               " fits two images, " + other->second + " and " +
                               name);
    }
    file_of_image.emplace(image_id, matches[0]);
  }
  return file_of_image;
}

std::vector<std::string> UnusedFiles(
    const FilesByName& files,
    const std::map<colmap::image_t, std::string>& file_of_image) {
  std::set<std::string> used;
  for (const auto& [image_id, file] : file_of_image) used.insert(file);
  std::vector<std::string> unused;
  for (const auto& [name, same_name_files] : files) {
    for (const std::string& file : same_name_files) {
      if (used.count(file) == 0) unused.push_back(file);
    }
  }
  return unused;
}

void CheckFolder(const std::string& path, const std::string& what) {
  if (fs::is_directory(path)) return;
  throw std::runtime_error(
      what + " folder " + path +
      (fs::exists(path) ? " is a file" : " does not exist"));
}

// Gives the depth maps their confidence maps.
void FindConfidences(const Scene& scene,
                     const std::string& confidence_path,
                     DepthFileSearch* search) {
  CheckFolder(confidence_path, "confidence");
  const auto names =
      MatchFilesToImages(scene, ListFolder(confidence_path), false);
  std::vector<std::string> images_without;
  for (auto& [image_id, file] : search->file_of_image) {
    const auto name = names.find(image_id);
    if (name == names.end()) {
      images_without.push_back(scene.images.at(image_id).Name());
    } else {
      file.confidence_path =
          (fs::path(confidence_path) / name->second).string();
    }
  }
  if (images_without.empty()) return;
  const std::string text = confidence_path + " has no confidence map of " +
                           std::to_string(images_without.size()) + " of " +
                           std::to_string(search->file_of_image.size()) +
                           " images with depth, e.g. " + images_without.front();
  if (images_without.size() == search->file_of_image.size()) {
    throw std::runtime_error(text +
                             ": name the files after the images, or leave "
                             "confidence_path out");
  }
  LOG(WARNING) << text << ": their depth is imported without";
}

}  // namespace

DepthFileSearch FindDepthFiles(const Scene& scene,
                               const std::string& depth_path,
                               const std::string& confidence_path) {
  const bool is_hdf5 =
      internal::IsHdf5Path(depth_path) && fs::is_regular_file(depth_path);
  if (!is_hdf5) CheckFolder(depth_path, "depth");
  const FilesByName files =
      is_hdf5 ? ListHdf5(depth_path) : ListFolder(depth_path);
  const auto names = MatchFilesToImages(scene, files, is_hdf5);
  DepthFileSearch search;
  search.files_without_image = UnusedFiles(files, names);
  for (const auto& [image_id, name] : names) {
    DepthFile& file = search.file_of_image[image_id];
    file.path = is_hdf5 ? depth_path : (fs::path(depth_path) / name).string();
    if (is_hdf5) file.group = name;
  }
  if (confidence_path.empty()) return search;

  FindConfidences(scene, confidence_path, &search);
  return search;
}

}  // namespace dgsfm
