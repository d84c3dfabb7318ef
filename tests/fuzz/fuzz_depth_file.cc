// Feeds a parser of depth or match files with arbitrary bytes: all it may do is
// throw std::runtime_error, within the memory that depth_file_formats.h allows.

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/formats/dense_match_file.h"
#include "colmap_ext/formats/depth_file_formats.h"
#include "colmap_ext/formats/hdf5_format.h"
#include "colmap_ext/formats/npz_format.h"
#include "tests/testing/npz_file.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

namespace dgsfm {
namespace {

using namespace internal;

std::string TemporaryPath(const std::string& extension) {
  return "/dev/shm/dgsfm_fuzz_" + std::to_string(getpid()) + extension;
}

// For libraries that read files only.
[[maybe_unused]] std::string WriteFile(const std::string& bytes,
                                       const std::string& extension) {
  const std::string path = TemporaryPath(extension);
  std::ofstream(path, std::ios::binary) << bytes;
  return path;
}

#ifdef DGSFM_FUZZ_MATCHES
// The bytes are arrays one behind the other: in an archive whose checksums
// hold, what is in them counts.
std::string WriteArrays(const std::string& text) {
  const std::string path = TemporaryPath(".npz");
  std::filesystem::remove(path);
  size_t begin = 0;
  for (const char* name : {"a<>b/keypoints0",
                           "a<>b/keypoints1",
                           "a<>b/scores",
                           "c<>d/matches",
                           "c<>d/confidence"}) {
    const size_t end = std::min(text.size(), text.find("\x93NUMPY", begin + 1));
    AddToNpz(path,
             std::string(name) + ".npy",
             text.substr(begin, end - begin),
             ZIP_CM_STORE);
    begin = end;
  }
  return path;
}
#endif

void Parse(const std::string& bytes) {
#if defined(DGSFM_FUZZ_NPY)
  ToGrid(ParseNpy(bytes));
#elif defined(DGSFM_FUZZ_NPZ)
  const NpzFile file(WriteFile(bytes, ".npz"));
  for (const std::string& name : file.Names()) file.Read(name);
#elif defined(DGSFM_FUZZ_PFM)
  ParsePfm(bytes);
#elif defined(DGSFM_FUZZ_PNG)
  ParsePng(bytes, bytes.size() % 2 == 0 ? 16 : 8);
#elif defined(DGSFM_FUZZ_BIN)
  ParseDenseBin(bytes);
#elif defined(DGSFM_FUZZ_EXR)
  ParseExr(bytes);
#elif defined(DGSFM_FUZZ_TIFF)
  ReadTiff(WriteFile(bytes, ".tif"));
#elif defined(DGSFM_FUZZ_HDF5)
  const Hdf5File file(WriteFile(bytes, ".h5"));
  for (const std::string& group : file.FindGroups("")) {
    file.Read(group, "depth");
  }
#elif defined(DGSFM_FUZZ_MATCHES)
  const DenseMatchFile file(WriteArrays(bytes));
  for (const std::string& group : file.Groups()) {
    try {
      file.Read(group);
    } catch (const std::runtime_error&) {
    }
  }
#elif defined(DGSFM_FUZZ_BLOB)
  if (bytes.size() < 4) return;
  const std::vector<uint8_t> blob(bytes.begin(), bytes.end());
  DecompressDepth({blob[0] + 256 * blob[1],
                   blob[2] + 256 * blob[3],
                   DepthUnit::METRIC,
                   {blob.begin() + 4, blob.end()}});
#endif
}

}  // namespace
}  // namespace dgsfm

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  try {
    dgsfm::Parse(std::string(data, data + size));
  } catch (const std::runtime_error&) {
  }
  return 0;
}
