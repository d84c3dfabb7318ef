// Synthetic graphs of images for the averages: true rotations, log scales and
// centres, and edges with noise, of which a share is false.

#pragma once

#include "estimators/averaging/rotation_averaging.h"
#include "estimators/averaging/scale_averaging.h"
#include "estimators/averaging/translation_averaging.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

enum class GraphLayout {
  STREET,  // a sequence, each node seen by the next ones
  CITY,    // a square grid, each node seen by those nearby
  RANDOM,  // all pairs alike
};

struct AveragingGraphOptions {
  GraphLayout layout = GraphLayout::CITY;
  int num_nodes = 100;
  int num_edges = 1000;
  // Share of edges with a random rotation and translation, and a scale ratio
  // 1.7 to 5.2 times too large or small: between random nodes, or among those
  // of the layout.
  double false_ratio = 0.3;
  bool false_neighbors = false;
  double rotation_noise_deg = 1;  // each component of the angle-axis vector
  double log_scale_noise = 0.02;
  double translation_noise_ratio = 0.1;
  unsigned seed = 1;
};

struct AveragingGraph {
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<double> log_scales;
  std::vector<Eigen::Vector3d> centers;
  std::vector<RelativeRotation> relative_rotations;
  std::vector<RelativeLogScale> ratios;
  std::vector<RelativeTranslation> translations;
  std::vector<char> is_false;
};

// Pairs of different nodes, those of the layout in order of distance until
// there are num_edges.
inline std::vector<std::pair<int, int>> LayoutEdges(GraphLayout layout,
                                                    int num_nodes,
                                                    int num_edges,
                                                    std::mt19937* random) {
  std::vector<std::pair<int, int>> edges;
  const auto add = [&](int node1, int node2) {
    if (int(edges.size()) < num_edges) edges.emplace_back(node1, node2);
  };
  std::uniform_int_distribution<int> node(0, num_nodes - 1);
  const int width = int(std::ceil(std::sqrt(num_nodes)));
  switch (layout) {
    case GraphLayout::STREET:
      for (int step = 1; step < num_nodes; ++step) {
        for (int i = 0; i + step < num_nodes; ++i) add(i, i + step);
      }
      break;
    case GraphLayout::CITY: {
      std::vector<std::pair<int, int>> offsets;
      for (int x = 0; x < width; ++x) {
        for (int y = x == 0 ? 1 : 1 - width; y < width; ++y) {
          offsets.emplace_back(x, y);
        }
      }
      std::stable_sort(
          offsets.begin(), offsets.end(), [](const auto& a, const auto& b) {
            return std::hypot(a.first, a.second) <
                   std::hypot(b.first, b.second);
          });
      for (const auto& [x, y] : offsets) {
        for (int i = 0; i < num_nodes && int(edges.size()) < num_edges; ++i) {
          const int other_x = i % width + x;
          const int other = i + x + y * width;
          if (other_x < width && other >= 0 && other < num_nodes) add(i, other);
        }
      }
      break;
    }
    case GraphLayout::RANDOM:
      // A random tree connects all.
      for (int i = 1; i < num_nodes; ++i) add(i, node(*random) % i);
      while (int(edges.size()) < num_edges) {
        const int node1 = node(*random);
        const int node2 = node(*random);
        if (node1 != node2) add(node1, node2);
      }
      break;
  }
  return edges;
}

inline AveragingGraph CreateAveragingGraph(
    const AveragingGraphOptions& options) {
  std::mt19937 random(options.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  std::uniform_int_distribution<int> random_node(0, options.num_nodes - 1);
  const auto random_vector = [&]() {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Eigen::Vector3d(x, y, z);
  };
  const auto random_rotation = [&]() {
    const Eigen::Vector3d xyz = random_vector();
    const double w = normal(random);
    return Eigen::Quaterniond(w, xyz.x(), xyz.y(), xyz.z()).normalized();
  };
  AveragingGraph graph;
  const int width = int(std::ceil(std::sqrt(options.num_nodes)));
  for (int i = 0; i < options.num_nodes; ++i) {
    graph.rotations.push_back(random_rotation());
    graph.log_scales.push_back(uniform(random) - 0.5);
    const Eigen::Vector3d place =
        options.layout == GraphLayout::STREET
            ? Eigen::Vector3d(i, 0, 0)
            : Eigen::Vector3d(i % width, i / width, 0);
    graph.centers.push_back(place + 0.2 * random_vector());
  }
  const int num_false = options.false_neighbors
                            ? 0
                            : int(options.false_ratio * options.num_edges);
  auto pairs = LayoutEdges(options.layout,
                           options.num_nodes,
                           options.num_edges - num_false,
                           &random);
  for (size_t e = 0; e < pairs.size(); ++e) {
    graph.is_false.push_back(options.false_neighbors &&
                             uniform(random) < options.false_ratio);
  }
  while (int(pairs.size()) < options.num_edges) {
    const int node1 = random_node(random);
    const int node2 = random_node(random);
    if (node1 == node2) continue;
    pairs.emplace_back(node1, node2);
    graph.is_false.push_back(1);
  }
  for (size_t e = 0; e < pairs.size(); ++e) {
    const auto [i, j] = pairs[e];
    const bool is_false = graph.is_false[e];
    const Eigen::Vector3d angle_axis =
        options.rotation_noise_deg * M_PI / 180 * random_vector();
    const double angle = angle_axis.norm();
    const Eigen::Quaterniond noise(
        Eigen::AngleAxisd(angle,
                          angle > 0 ? Eigen::Vector3d(angle_axis / angle)
                                    : Eigen::Vector3d::UnitX()));
    graph.relative_rotations.push_back(
        {i,
         j,
         is_false
             ? random_rotation()
             : noise * graph.rotations[j] * graph.rotations[i].conjugate()});
    const double gross_error =
        is_false ? std::copysign(std::log(3.0) * (0.5 + uniform(random)),
                                 normal(random))
                 : 0.0;
    graph.ratios.push_back({i,
                            j,
                            graph.log_scales[j] - graph.log_scales[i] +
                                options.log_scale_noise * normal(random) +
                                gross_error});
    RelativeTranslation relative;
    relative.node1 = i;
    relative.node2 = j;
    relative.translation = graph.centers[j] - graph.centers[i];
    if (is_false) relative.translation = 3 * random_vector();
    relative.stddev =
        options.translation_noise_ratio * relative.translation.norm();
    relative.translation += relative.stddev * random_vector();
    graph.translations.push_back(relative);
  }
  return graph;
}

}  // namespace dgsfm
