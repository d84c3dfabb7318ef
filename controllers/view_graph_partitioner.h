// The controller of view_graph_partitioner: lists of images that are mapped by
// themselves.

#pragma once

#include "estimators/graph_partition.h"

#include <string>
#include <vector>

namespace dgsfm {

struct ViewGraphPartition {
  // Names of the images of each part, in the order of their ids.
  std::vector<std::vector<std::string>> parts;
  // Images without a valid pair, which are in no part.
  std::vector<std::string> images_without_pairs;
};

// Cuts the graph of the valid pairs of a database, weighted by their inliers.
// Images of a frame of a rig stay together: the rigs of the database, or those
// of a file of COLMAP's rig_configurator if its path is not empty. Throws
// std::runtime_error if no pair of the database is verified and valid.
ViewGraphPartition PartitionViewGraph(const std::string& database_path,
                                      const GraphPartitionOptions& options,
                                      const std::string& rig_config_path = "");

}  // namespace dgsfm
