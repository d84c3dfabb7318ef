#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cctype>
#include <exception>
#include <limits>
#include <mutex>
#include <stdexcept>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStdIO.h>

namespace dgsfm::internal {
namespace {

// Blender, for one, writes 1e10 where there is nothing.
constexpr float kRendererInfinity = 1e9;

// Behind the names of layers, in small letters.
std::string LastName(const std::string& name) {
  std::string last = name.substr(name.rfind('.') + 1);
  for (char& c : last) c = std::tolower(static_cast<unsigned char>(c));
  return last;
}

// Renderers name the channel by their own custom.
std::string FindDepthChannel(const Imf::ChannelList& channels) {
  std::vector<std::string> names;
  std::string all;
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    names.push_back(it.name());
    all += (all.empty() ? "" : ", ") + names.back();
  }
  if (names.size() == 1) return names.front();
  for (const char* wanted : {"z", "depth", "v", "y"}) {
    const auto name = std::find_if(
        names.begin(), names.end(), [wanted](const std::string& candidate) {
          return LastName(candidate) == wanted;
        });
    if (name != names.end()) return *name;
  }
  throw std::runtime_error("none of the EXR's channels (" + all +
                           ") is called Z, depth, V or Y");
}

DepthGrid ReadPixels(size_t file_size, Imf::InputFile* file) {
  const Imf::Header& header = file->header();
  const Imath::Box2i window = header.displayWindow();
  const Imath::Box2i data = header.dataWindow();
  // As 64 bits, which no difference of 32 overflows.
  const auto size = [](int min, int max) {
    return static_cast<uint64_t>(std::max<int64_t>(0, int64_t(max) - min + 1));
  };
  const uint64_t width = size(window.min.x, window.max.x);
  const uint64_t height = size(window.min.y, window.max.y);
  const uint64_t data_width = size(data.min.x, data.max.x);
  const uint64_t data_height = size(data.min.y, data.max.y);
  CheckGridSize(width, height);
  CheckGridSize(data_width, data_height);
  // At least half floats.
  CheckExpansion(2 * std::max(width * height, data_width * data_height),
                 file_size);
  const std::string name = FindDepthChannel(header.channels());
  const Imf::Channel& channel = header.channels()[name.c_str()];
  if (channel.xSampling != 1 || channel.ySampling != 1) {
    throw std::runtime_error("the EXR's channel " + name + " is subsampled");
  }

  std::vector<float> values(data_width * data_height);
  Imf::FrameBuffer frame_buffer;
  frame_buffer.insert(
      name,
      Imf::Slice::Make(
          Imf::FLOAT, values.data(), data, sizeof(float), 0, 1, 1, 0.0));
  file->setFrameBuffer(frame_buffer);
  file->readPixels(data.min.y, data.max.y);

  DepthGrid grid = {static_cast<int>(width),
                    static_cast<int>(height),
                    std::vector<float>(width * height)};
  for (uint64_t y = 0; y < data_height; ++y) {
    const int64_t grid_y = data.min.y - int64_t(window.min.y) + int64_t(y);
    // The data window may be smaller or larger than the image, or beside it.
    if (grid_y < 0 || grid_y >= grid.height) continue;
    for (uint64_t x = 0; x < data_width; ++x) {
      const int64_t grid_x = data.min.x - int64_t(window.min.x) + int64_t(x);
      if (grid_x < 0 || grid_x >= grid.width) continue;
      const float value = values[y * data_width + x];
      grid.values[grid_y * grid.width + grid_x] =
          value < kRendererInfinity ? value
                                    : std::numeric_limits<float>::infinity();
    }
  }
  return grid;
}

}  // namespace

DepthGrid ParseExr(const std::string& bytes) {
  // Bounds what a damaged header can make OpenEXR allocate.
  static std::once_flag is_limited;
  std::call_once(is_limited, [] {
    Imf::Header::setMaxImageSize(kMaxDepthMapSize, kMaxDepthMapSize);
    Imf::Header::setMaxTileSize(kMaxDepthMapSize, kMaxDepthMapSize);
  });
  try {
    Imf::StdISStream stream;
    stream.str(bytes);
    Imf::InputFile file(stream, /*numThreads=*/0);
    return ReadPixels(bytes.size(), &file);
  } catch (const std::exception& error) {
    throw std::runtime_error(std::string("EXR: ") + error.what());
  }
}

std::string FormatExr(const DepthGrid& grid) {
  Imf::StdOSStream output;
  try {
    Imf::Header header(grid.width, grid.height);
    // Lossless, and read by every program.
    header.compression() = Imf::ZIP_COMPRESSION;
    header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
    Imf::FrameBuffer frame_buffer;
    // OpenEXR does not write to what it takes without const.
    char* pixels =
        reinterpret_cast<char*>(const_cast<float*>(grid.values.data()));
    frame_buffer.insert(
        "Z",
        Imf::Slice(
            Imf::FLOAT, pixels, sizeof(float), sizeof(float) * grid.width));
    Imf::OutputFile file(output, header, /*numThreads=*/0);
    file.setFrameBuffer(frame_buffer);
    file.writePixels(grid.height);
  } catch (const std::exception& error) {
    throw std::runtime_error(std::string("EXR: ") + error.what());
  }
  return output.str();
}

}  // namespace dgsfm::internal
