// Runs the tests with COLMAP's random numbers reseeded before each of them.

#include <colmap/util/random.h>

#include <glog/logging.h>
#include <gtest/gtest.h>

namespace {

class ReseedBeforeTest : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo&) override {
    colmap::SetPRNGSeed(0);
  }
};

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  google::InitGoogleLogging(argv[0]);
  FLAGS_minloglevel = google::GLOG_WARNING;
  FLAGS_logtostderr = true;
  testing::UnitTest::GetInstance()->listeners().Append(new ReseedBeforeTest);
  return RUN_ALL_TESTS();
}
