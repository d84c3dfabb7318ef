#include "controllers/pair_score_file.h"

#include "tests/testing/test_dir.h"

#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

// Images x/a.jpg (1), x/b c.jpg (2), x/d.jpg (3) and y/d.jpg (4).
Scene CreateScene() {
  Scene scene;
  colmap::image_t image_id = 0;
  for (const char* name : {"x/a.jpg", "x/b c.jpg", "x/d.jpg", "y/d.jpg"}) {
    colmap::Image image;
    image.SetImageId(++image_id);
    image.SetName(name);
    scene.images.emplace(image_id, image);
  }
  return scene;
}

PairScores Read(const std::string& name, const std::string& text) {
  const std::string path = CreateTestDir() + "/" + name;
  std::ofstream(path) << text;
  return ReadPairScores(path, CreateScene());
}

void ExpectError(const std::string& name,
                 const std::string& text,
                 const std::string& place,
                 const std::string& problem) {
  EXPECT_THAT([&] { Read(name, text); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(name + place), HasSubstr(problem))))
      << text;
}

TEST(PairScoreFile, ReadsEveryForm) {
  const PairScores expected = {{PairIdOfImages(1, 2), 0.25},
                               {PairIdOfImages(1, 3), 1}};
  EXPECT_EQ(Read("a.txt",
                 "# Doppelgangers++\n\nx/a.jpg<>x/b c.jpg<>0.25\n"
                 "x/d.jpg<>x/a.jpg 1\n"),
            expected);
  EXPECT_EQ(Read("a.csv",
                 "image1,image2,score\n\"x/a.jpg\", x/b c.jpg ,0.25\r\n"
                 "x/d.jpg,x/a.jpg,1\n"),
            expected);
  EXPECT_EQ(
      Read("a.json", R"({"x/a.jpg<>x/b c.jpg": 0.25, "x/d.jpg<>x/a.jpg": 1})"),
      expected);
  EXPECT_EQ(Read("a.json",
                 R"([["x/a.jpg", "x/b c.jpg", 0.25],
                     {"image1": "x/d.jpg", "image2": "x/a.jpg", "score": 1}])"),
            expected);
  const PairScores plain = {{PairIdOfImages(1, 4), 0.5}};
  EXPECT_EQ(Read("a.txt", "x/a.jpg\ty/d.jpg  0.5"), plain);
  EXPECT_EQ(Read("a.txt", "a.jpg y/d.jpg 5e-1\na.jpg y/d.jpg 0.5"), plain);
  EXPECT_EQ(Read("a.csv", "\xef\xbb\xbfx/a.jpg,y/d.jpg,0.5\r\n"), plain);
  EXPECT_TRUE(Read("a.txt", "").empty());
  EXPECT_EQ(Read("a.csv", "\"x/a.jpg\",y/d.jpg,.5"), plain);
  EXPECT_TRUE(Read("a.json", "{}").empty());
}

TEST(PairScoreFile, NamesWhatIsWrong) {
  const std::string expected = "expected two image names and a score";
  ExpectError("a.txt", "\nx/a.jpg x/d.jpg", ":2", expected);
  ExpectError("a.txt", "x/a.jpg x/d.jpg 1 2", ":1", expected);
  ExpectError("a.txt", "x/a.jpg<>x/d.jpg", ":1", expected);
  ExpectError("a.txt", "x/a.jpg x/d.jpg one", ":1", expected);
  ExpectError("a.csv", "x/a.jpg,x/d.jpg,1\nx/a.jpg,x/d.jpg", ":2", expected);
  ExpectError("a.txt", "x/a.jpg x/d.jpg 1.5", ":1", "score is not in [0, 1]");
  ExpectError("a.txt", "x/a.jpg x/d.jpg nan", ":1", "score is not in [0, 1]");
  ExpectError("a.txt", "x/a.jpg z.jpg 1", ":1", "z.jpg is not in the database");
  ExpectError("a.txt", "x/a.jpg d.jpg 1", ":1", "d.jpg is in several folders");
  ExpectError("a.txt", "a.jpg x/a.jpg 1", ":1", "both names are a.jpg");
  ExpectError("a.txt",
              "a.jpg x/d.jpg 1\nx/d.jpg a.jpg 0",
              ":2",
              "the pair has another score before");
  ExpectError("a.json", "{", "", "neither an object nor a list");
  ExpectError("a.json", "{\"a.jpg\": 1}", ", entry a.jpg", expected);
  ExpectError("a.json", "[[\"a.jpg\", 1, 1]]", ", entry 0", expected);
  ExpectError(
      "a.json", R"([["x/a.jpg", "x/d.jpg", 1, 0]])", ", entry 0", expected);
  ExpectError("a.json",
              R"({"x/a.jpg<>x/d.jpg<>y/d.jpg": 1})",
              ", entry x/a.jpg",
              expected);
  EXPECT_THROW(ReadPairScores("missing.txt", CreateScene()),
               std::runtime_error);
}

}  // namespace
}  // namespace dgsfm
