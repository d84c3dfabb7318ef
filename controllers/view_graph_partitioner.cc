#include "controllers/view_graph_partitioner.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/rig_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/output_file.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/output_folder.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <set>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

// The images of each node of the graph: those of a frame, or one.
class ImageNodes {
 public:
  ImageNodes(const Scene& scene, const std::set<colmap::image_t>& image_ids) {
    for (const auto& [frame_id, frame] : scene.rigs.frames) {
      std::vector<colmap::image_t> node;
      for (const auto& [camera_id, image_id] : frame.images) {
        if (image_ids.count(image_id) > 0) node.push_back(image_id);
      }
      if (!node.empty()) Add(node);
    }
    for (const colmap::image_t image_id : image_ids) {
      if (node_of_image_.count(image_id) == 0) Add({image_id});
    }
  }

  int NodeOf(colmap::image_t image_id) const {
    return node_of_image_.at(image_id);
  }
  const std::vector<colmap::image_t>& ImagesOf(int node) const {
    return images_[node];
  }
  std::vector<int> Sizes() const {
    std::vector<int> sizes;
    for (const auto& images : images_) sizes.push_back(int(images.size()));
    return sizes;
  }

 private:
  void Add(const std::vector<colmap::image_t>& image_ids) {
    for (const colmap::image_t image_id : image_ids) {
      node_of_image_[image_id] = int(images_.size());
    }
    images_.push_back(image_ids);
  }

  std::vector<std::vector<colmap::image_t>> images_;
  std::map<colmap::image_t, int> node_of_image_;
};

std::string PartFile(size_t index) {
  char name[32];
  std::snprintf(name, sizeof(name), "part_%04zu.txt", index);
  return name;
}

// Lists of an earlier run would be taken for parts of this one.
void RemoveEarlierParts(const std::string& folder) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("part_", 0) == 0 && entry.path().extension() == ".txt") {
      fs::remove(entry.path());
    }
  }
}

void WriteParts(const ViewGraphPartition& partition,
                const GraphPartitionOptions& options,
                const std::string& folder) {
  CreateOutputFolder(folder);
  RemoveEarlierParts(folder);
  nlohmann::ordered_json parts = nlohmann::ordered_json::array();
  std::map<std::string, size_t> num_parts_of_image;
  for (size_t i = 0; i < partition.parts.size(); ++i) {
    std::string text;
    for (const std::string& name : partition.parts[i]) {
      text += name + "\n";
      ++num_parts_of_image[name];
    }
    WriteFile((fs::path(folder) / PartFile(i)).string(), text);
  }
  for (size_t i = 0; i < partition.parts.size(); ++i) {
    size_t num_shared = 0;
    for (const std::string& name : partition.parts[i]) {
      num_shared += num_parts_of_image[name] > 1;
    }
    parts.push_back({{"images", PartFile(i)},
                     {"num_images", partition.parts[i].size()},
                     {"num_shared", num_shared}});
  }
  // Last, so that it stands for all of them.
  WriteFile(
      (fs::path(folder) / "partition.json").string(),
      JsonText(nlohmann::ordered_json{{"max_part_size", options.max_part_size},
                                      {"overlap", options.overlap},
                                      {"parts", parts},
                                      {"images_without_pairs",
                                       partition.images_without_pairs}},
               2) +
          "\n");
}

}  // namespace

ViewGraphPartition PartitionViewGraph(const std::string& database_path,
                                      const GraphPartitionOptions& options,
                                      const std::string& rig_config_path) {
  CheckOptions(options);
  Scene scene = ReadScene(database_path, SceneContent::IMAGES);
  scene.rigs = ReadRigs(database_path, rig_config_path, scene);
  const auto pairs =
      DepthDatabase(database_path, DepthDatabase::Mode::READ_ONLY)
          .ReadValidPairs();
  std::set<colmap::image_t> image_ids;
  for (const auto& [pair_id, num_inliers] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (scene.images.count(image_id1) == 0 ||
        scene.images.count(image_id2) == 0) {
      continue;  // Images were deleted since.
    }
    image_ids.insert({image_id1, image_id2});
  }
  if (image_ids.empty()) {
    throw std::runtime_error(database_path +
                             " has no verified pairs that are valid; run "
                             "depth_geometric_verifier first");
  }
  const ImageNodes nodes(scene, image_ids);
  std::vector<GraphEdge> edges;
  std::vector<int> weights;
  for (const auto& [pair_id, num_inliers] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (image_ids.count(image_id1) == 0 || image_ids.count(image_id2) == 0) {
      continue;
    }
    edges.emplace_back(nodes.NodeOf(image_id1), nodes.NodeOf(image_id2));
    weights.push_back(int(num_inliers) + 1);
  }
  ViewGraphPartition partition;
  for (const std::vector<int>& part :
       PartitionGraph(options, nodes.Sizes(), edges, weights)) {
    std::set<colmap::image_t> part_ids;
    for (const int node : part) {
      const auto& of_node = nodes.ImagesOf(node);
      part_ids.insert(of_node.begin(), of_node.end());
    }
    std::vector<std::string>& names = partition.parts.emplace_back();
    for (const colmap::image_t image_id : part_ids) {
      names.push_back(scene.images.at(image_id).Name());
    }
  }
  for (const auto& [image_id, image] : scene.images) {
    if (image_ids.count(image_id) > 0) continue;
    partition.images_without_pairs.push_back(image.Name());
  }
  return partition;
}

int RunViewGraphPartitioner(int argc, char** argv) {
  std::string database_path, output_path, rig_config_path;
  GraphPartitionOptions options;
  CommandOptions command_options(
      "view_graph_partitioner",
      "Divides the images of a database, whose pairs are verified, into "
      "overlapping parts.");
  command_options.AddRequired(
      "database_path", &database_path, "COLMAP database");
  command_options.AddRequired("output_path",
                              &output_path,
                              "folder of the lists of images, part_0000.txt "
                              "..., and partition.json; created if missing");
  command_options.Add(
      "max_part_size", &options.max_part_size, "images of a part, at most");
  command_options.Add("overlap",
                      &options.overlap,
                      "share of these that are of neighbouring parts, too [1]");
  command_options.Add("rig_config_path",
                      &rig_config_path,
                      "rig_config.json of COLMAP's rig_configurator, in place "
                      "of the rigs of the database");
  if (const auto exit_code = command_options.Parse(argc, argv)) {
    return *exit_code;
  }
  const ViewGraphPartition partition =
      PartitionViewGraph(database_path, options, rig_config_path);
  WriteParts(partition, options, output_path);
  std::cout << partition.parts.size() << " parts, "
            << partition.images_without_pairs.size()
            << " images without valid pairs" << std::endl;
  return 0;
}

}  // namespace dgsfm
