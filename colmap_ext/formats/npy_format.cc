#include "colmap_ext/formats/depth_file_formats.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <type_traits>

#include <Eigen/Core>
#include <boost/endian/conversion.hpp>

namespace dgsfm::internal {
namespace {

const std::string kMagic = "\x93NUMPY";
// Magic and two bytes of version, then the length of the header.
constexpr size_t kVersionEnd = 8;
// NumPy aligns the data so.
constexpr size_t kAlignment = 64;
// Bounds the recursion of regular expressions; plain arrays need some 100.
constexpr size_t kMaxTextSize = 4096;

struct NpyHeader {
  std::string type;  // kind and size, e.g. "f4"
  bool is_big_endian = false;
  bool is_fortran_order = false;
  std::vector<uint64_t> shape;
  size_t data_begin = 0;
};

// Finds the value of a key in the header's Python dictionary, whose keys NumPy
// writes in any order. Throws unless the pattern matches it.
std::smatch FindValue(const std::string& text,
                      const std::string& key,
                      const std::string& pattern,
                      const std::string& problem) {
  const std::string quoted_key = "'" + key + "':";
  if (text.find(quoted_key) == std::string::npos) {
    throw std::runtime_error("NumPy header without " + key);
  }
  std::smatch match;
  if (!std::regex_search(
          text, match, std::regex(quoted_key + " *" + pattern))) {
    throw std::runtime_error(problem);
  }
  return match;
}

// Reads a header such as
// {'descr': '<f4', 'fortran_order': False, 'shape': (48, 64), }
NpyHeader ParseText(const std::string& text) {
  if (text.size() > kMaxTextSize) {
    throw std::runtime_error("NumPy header of an array of no plain numbers");
  }
  const std::string unreadable = "NumPy header with an unreadable ";
  NpyHeader header;
  const std::smatch type = FindValue(text,
                                     "descr",
                                     "'([^'])([^']{1,20})'",
                                     "its elements are not plain numbers");
  header.is_big_endian = type[1] == ">";
  header.type = type[2];
  header.is_fortran_order =
      FindValue(text,
                "fortran_order",
                "(True|False)",
                unreadable + "fortran_order")[1] == "True";
  std::string shape =
      FindValue(text, "shape", "\\(([0-9, ]*)\\)", unreadable + "shape")[1];
  if (std::regex_search(shape, std::regex("[0-9]{10}"))) {
    throw std::runtime_error(unreadable + "shape");
  }
  std::replace(shape.begin(), shape.end(), ',', ' ');
  std::istringstream sizes(shape);
  for (uint64_t size = 0; sizes >> size;) header.shape.push_back(size);
  return header;
}

NpyHeader ParseHeader(const std::string& bytes) {
  if (bytes.size() < kVersionEnd + 4 || bytes.rfind(kMagic, 0) != 0) {
    throw std::runtime_error("not a NumPy array");
  }
  const int version = static_cast<uint8_t>(bytes[kMagic.size()]);
  if (version < 1 || version > 3) {
    throw std::runtime_error("NumPy format version " + std::to_string(version) +
                             " is not supported");
  }
  const auto* length =
      reinterpret_cast<const uint8_t*>(bytes.data()) + kVersionEnd;
  const size_t text_begin = kVersionEnd + (version == 1 ? 2 : 4);
  const size_t text_size = version == 1
                               ? boost::endian::load_little_u16(length)
                               : boost::endian::load_little_u32(length);
  if (text_size > bytes.size() - text_begin) {
    throw std::runtime_error("NumPy header is truncated");
  }
  NpyHeader header = ParseText(bytes.substr(text_begin, text_size));
  header.data_begin = text_begin + text_size;
  return header;
}

// The same for all numbers, without branches, so that compilers vectorize it.
float HalfToFloat(uint16_t half) {
  constexpr uint32_t kInfinity = 0x7f800000;
  const uint32_t magnitude = uint32_t(half & 0x7fff) << 13;
  // 2^112 is what the exponents of halfs and floats differ by.
  const float scaled =
      Eigen::numext::bit_cast<float>(magnitude) * 5.192296858534828e33f;
  const bool is_finite = (half & 0x7c00) != 0x7c00;
  const uint32_t bits = is_finite ? Eigen::numext::bit_cast<uint32_t>(scaled)
                                  : magnitude | kInfinity;
  return Eigen::numext::bit_cast<float>(bits | uint32_t(half & 0x8000) << 16);
}

// Converts little-endian numbers.
template <typename T>
void LoadNumbers(const char* data, std::vector<float>* values) {
  if constexpr (std::is_same_v<T, float>) {
    std::copy_n(data,
                sizeof(float) * values->size(),
                reinterpret_cast<char*>(values->data()));
    return;
  }
  for (float& value : *values) {
    if constexpr (std::is_same_v<T, Eigen::half>) {
      value = HalfToFloat(LoadNumber<uint16_t>(data));
    } else {
      value = static_cast<float>(LoadNumber<T>(data));
    }
    data += sizeof(T);
  }
}

struct ElementType {
  size_t size = 0;
  void (*load)(const char*, std::vector<float>*) = nullptr;
};

template <typename T>
constexpr ElementType CreateElementType() {
  return {sizeof(T), LoadNumbers<T>};
}

const ElementType& FindElementType(const std::string& name) {
  static const std::map<std::string, ElementType> kTypes = {
      {"f2", CreateElementType<Eigen::half>()},
      {"f4", CreateElementType<float>()},
      {"f8", CreateElementType<double>()},
      {"b1", CreateElementType<uint8_t>()},
      {"i1", CreateElementType<int8_t>()},
      {"i2", CreateElementType<int16_t>()},
      {"i4", CreateElementType<int32_t>()},
      {"i8", CreateElementType<int64_t>()},
      {"u1", CreateElementType<uint8_t>()},
      {"u2", CreateElementType<uint16_t>()},
      {"u4", CreateElementType<uint32_t>()},
      {"u8", CreateElementType<uint64_t>()}};
  const auto type = kTypes.find(name);
  if (type == kTypes.end()) {
    throw std::runtime_error("elements of type '" + name +
                             "' are not supported");
  }
  return type->second;
}

// NumPy's order is height, width.
std::string FormatShape(const std::vector<uint64_t>& shape) {
  std::string text;
  // Error messages give sizes as width x height.
  for (auto size = shape.rbegin(); size != shape.rend(); ++size) {
    text += (text.empty() ? "" : " x ") + std::to_string(*size);
  }
  return text;
}

// Values of an array whose first index runs fastest, in C order.
std::vector<float> ReorderFortran(const std::vector<float>& values,
                                  const std::vector<uint64_t>& shape) {
  std::vector<float> reordered(values.size());
  std::vector<uint64_t> index(shape.size(), 0);
  for (float& value : reordered) {
    size_t pos = 0;
    for (size_t dim = shape.size(); dim-- > 0;) {
      pos = pos * shape[dim] + index[dim];
    }
    value = values[pos];
    for (size_t dim = shape.size(); dim-- > 0;) {
      if (++index[dim] < shape[dim]) break;
      index[dim] = 0;
    }
  }
  return reordered;
}

// An array of the type, whose numbers follow the header.
template <typename Number, typename Convert>
std::string FormatNpy(const std::string& type,
                      const DepthGrid& grid,
                      const Convert& convert) {
  std::string text =
      "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" +
      std::to_string(grid.height) + ", " + std::to_string(grid.width) + "), }";
  const size_t unpadded_size = kVersionEnd + 2 + text.size() + 1;
  text.append((kAlignment - unpadded_size % kAlignment) % kAlignment, ' ');
  // The padding comes before the line break, which ends the header.
  text.push_back('\n');

  std::string bytes = kMagic + std::string("\x01\x00", 2);
  bytes.push_back(static_cast<char>(text.size() & 0xff));
  bytes.push_back(static_cast<char>(text.size() >> 8));
  bytes += text;
  size_t pos = bytes.size();
  bytes.resize(pos + sizeof(Number) * grid.values.size());
  for (const float value : grid.values) {
    const Number number = convert(value);
    std::memcpy(&bytes[pos], &number, sizeof(number));
    pos += sizeof(number);
  }
  return bytes;
}

}  // namespace

NumberArray ParseNpy(std::string bytes) {
  const NpyHeader header = ParseHeader(bytes);
  const ElementType& type = FindElementType(header.type);
  const uint64_t num_values = CountValues(header.shape);
  const size_t data_size = bytes.size() - header.data_begin;
  if (data_size != num_values * type.size) {
    throw std::runtime_error(std::to_string(data_size) +
                             " bytes of data instead of the " +
                             std::to_string(num_values * type.size) + " of " +
                             FormatShape(header.shape) + " values");
  }
  // Rare, so that a pass of its own does not matter.
  if (header.is_big_endian) {
    for (size_t i = header.data_begin; i < bytes.size(); i += type.size) {
      std::reverse(&bytes[i], &bytes[i] + type.size);
    }
  }
  NumberArray array = {header.shape, std::vector<float>(num_values)};
  type.load(bytes.data() + header.data_begin, &array.values);
  if (header.is_fortran_order) {
    array.values = ReorderFortran(array.values, array.shape);
  }
  return array;
}

std::vector<float> HalfsToFloats(const std::vector<uint16_t>& halfs) {
  std::vector<float> values(halfs.size());
  std::transform(halfs.begin(), halfs.end(), values.begin(), HalfToFloat);
  return values;
}

std::string FormatNpyHalf(const DepthGrid& grid) {
  return FormatNpy<Eigen::half>(
      "<f2", grid, [](float value) { return Eigen::half(value); });
}

std::string FormatNpyFloat(const DepthGrid& grid) {
  return FormatNpy<float>("<f4", grid, [](float value) { return value; });
}

}  // namespace dgsfm::internal
