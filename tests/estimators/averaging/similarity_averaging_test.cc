#include "estimators/averaging/similarity_averaging.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

Similarity3d RandomSimilarity(std::mt19937* rng) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto random = [&] {
    return Eigen::Vector3d(uniform(*rng), uniform(*rng), uniform(*rng));
  };
  Similarity3d similarity;
  similarity.scale = std::exp(uniform(*rng));
  const Eigen::Vector3d vector = 3 * random();
  similarity.rotation = Eigen::AngleAxisd(vector.norm(), vector.normalized());
  similarity.translation = 50 * random();
  return similarity;
}

Similarity3d Compose(const Similarity3d& c_from_b,
                     const Similarity3d& b_from_a) {
  return {c_from_b.scale * b_from_a.scale,
          c_from_b.rotation * b_from_a.rotation,
          c_from_b * b_from_a.translation};
}

TEST(AverageSimilarities, FindsTheFrameOfAllButAnOutlier) {
  std::mt19937 rng(0);
  std::vector<Similarity3d> world_from_node;
  for (int i = 0; i < 8; ++i) world_from_node.push_back(RandomSimilarity(&rng));
  std::vector<RelativeSimilarity> edges;
  for (int i = 0; i < 8; ++i) {
    for (int j = i + 1; j < 8; ++j) {
      RelativeSimilarity edge;
      edge.node1 = i;
      edge.node2 = j;
      edge.node2_from_node1 =
          Compose(world_from_node[j].Inverse(), world_from_node[i]);
      edge.anchor_in_1 = Eigen::Vector3d(i, j, 3);
      edges.push_back(edge);
    }
  }
  edges[4].node2_from_node1 = RandomSimilarity(&rng);
  std::vector<Similarity3d> averaged;
  ASSERT_TRUE(AverageSimilarities(8, edges, 2, {}, &averaged));
  for (int i = 0; i < 8; ++i) {
    const Similarity3d expected =
        Compose(world_from_node[2].Inverse(), world_from_node[i]);
    EXPECT_NEAR(averaged[i].scale, expected.scale, 1e-6 * expected.scale);
    EXPECT_LT(averaged[i].rotation.angularDistance(expected.rotation), 1e-6);
    EXPECT_LT((averaged[i].translation - expected.translation).norm(), 1e-4);
  }
}

TEST(AverageSimilarities, FailsForAGraphInTwoPieces) {
  std::vector<Similarity3d> averaged;
  RelativeSimilarity edge;
  edge.node2 = 1;
  EXPECT_FALSE(AverageSimilarities(3, {edge}, 0, {}, &averaged));
}

}  // namespace
}  // namespace dgsfm
