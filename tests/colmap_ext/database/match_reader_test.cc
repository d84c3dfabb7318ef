#include "colmap_ext/database/match_reader.h"

#include "colmap_ext/database/scene_database.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/test_dir.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

using Indices = std::vector<std::pair<colmap::point2D_t, colmap::point2D_t>>;

Indices IndicesOf(const colmap::FeatureMatches& matches) {
  Indices indices;
  for (const colmap::FeatureMatch& match : matches) {
    indices.emplace_back(match.point2D_idx1, match.point2D_idx2);
  }
  return indices;
}

// Images 1 to 4 with three key points each.
class MatchReaderTest : public testing::Test {
 protected:
  MatchReaderTest() : path_(CreateTestDir() + "/database.db") {
    ColmapDatabaseWriter writer(path_, ColmapSchema::V4_2);
    writer.AddCamera(0, 640, 480, {500, 320, 240});
    for (const char* name : {"a.jpg", "b.jpg", "c.jpg", "d.jpg"}) {
      writer.AddImage(name, 1, {{1, 2}, {3, 4}, {5, 6}});
    }
    // Matches of the pairs (1, 2) with a duplicate, (1, 3) only verified, (2,
    // 3) not verified, (3, 4) without matches.
    writer.AddMatches(1, 2, {{2, 0}, {0, 1}, {2, 0}});
    writer.AddMatches(1, 3, {{1, 1}, {2, 2}});
    writer.Execute("DELETE FROM matches WHERE pair_id = 2147483650");
    writer.AddMatches(2, 3, {{0, 0}}, /*verified=*/false);
    writer.AddMatches(3, 4, {});
  }

  const std::string path_;
};

TEST_F(MatchReaderTest, GivesTheMatchesOfTheScenePairByPair) {
  const Scene scene = ReadScene(path_);
  ASSERT_EQ(scene.matches.size(), 3);
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_ONLY);
  MatchReader reader(connection, scene);
  const std::vector<MatchReader::PairSize> pairs = reader.ListPairs();
  ASSERT_EQ(pairs.size(), 3);
  EXPECT_EQ(pairs[0].num_matches, 3);
  EXPECT_EQ(pairs[1].num_matches, 2);
  EXPECT_EQ(pairs[2].num_matches, 1);
  auto expected = scene.matches.begin();
  for (const MatchReader::PairSize& pair : pairs) {
    EXPECT_EQ(pair.pair_id, expected->first);
    EXPECT_EQ(IndicesOf(reader.Read(pair.pair_id)),
              IndicesOf(expected->second));
    ++expected;
  }
  EXPECT_EQ(IndicesOf(reader.Read(pairs[0].pair_id)),
            (Indices{{2, 0}, {0, 1}}));
  EXPECT_TRUE(reader.Read(PairIdOfImages(3, 4)).empty());
}

TEST_F(MatchReaderTest, LocksTheDatabaseOnlyWhileItReads) {
  const Scene scene = ReadScene(path_);
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_ONLY);
  MatchReader reader(connection, scene);
  SqliteConnection writer(
      path_, SqliteConnection::Mode::READ_WRITE, std::chrono::milliseconds(0));
  for (const MatchReader::PairSize& pair : reader.ListPairs()) {
    reader.Read(pair.pair_id);
    EXPECT_NO_THROW(writer.Execute("UPDATE images SET name = name || 'x'"));
  }
}

TEST_F(MatchReaderTest, NamesThePairOfABadRow) {
  const Scene scene = ReadScene(path_);
  const SqliteConnection connection(path_, SqliteConnection::Mode::READ_ONLY);
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE matches SET rows = 9 WHERE pair_id = 2147483649");
  MatchReader reader(connection, scene);
  EXPECT_THAT([&] { reader.Read(PairIdOfImages(1, 2)); },
              ThrowsMessage<std::runtime_error>(
                  HasSubstr("pair a.jpg - b.jpg: 9 x 2")));
}

}  // namespace
}  // namespace dgsfm
