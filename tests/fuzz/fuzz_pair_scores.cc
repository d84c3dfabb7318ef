// Reads pair scores from arbitrary text, the first byte tells the format: all
// the reader may do is throw std::runtime_error.

#include "controllers/pair_score_file.h"

#include <fstream>
#include <stdexcept>
#include <string>

#include <unistd.h>

namespace dgsfm {
namespace {

Scene CreateScene() {
  Scene scene;
  colmap::image_t image_id = 0;
  for (const char* name : {"a.jpg", "x/b c.jpg", "y/d.jpg", "z/d.jpg"}) {
    colmap::Image image;
    image.SetImageId(++image_id);
    image.SetName(name);
    scene.images.emplace(image_id, image);
  }
  return scene;
}

}  // namespace
}  // namespace dgsfm

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace dgsfm;
  static const Scene scene = CreateScene();
  if (size == 0) return 0;
  const char* const extensions[] = {".txt", ".csv", ".json"};
  const std::string path = "/dev/shm/dgsfm_fuzz_" + std::to_string(getpid()) +
                           extensions[data[0] % 3];
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data) + 1, size - 1);
  try {
    ReadPairScores(path, scene);
  } catch (const std::runtime_error&) {
  }
  return 0;
}
