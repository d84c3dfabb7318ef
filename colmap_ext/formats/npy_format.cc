#include "colmap_ext/formats/depth_file_formats.h"

#include <cctype>
#include <cstring>
#include <map>
#include <stdexcept>
#include <utility>

#include <Eigen/Core>
#include <boost/endian/conversion.hpp>

namespace dgsfm::internal {
namespace {

using boost::endian::endian_load;
using boost::endian::endian_store;
using boost::endian::order;

const std::string kMagic = "\x93NUMPY";
// Magic and two bytes of version, then the length of the header.
constexpr size_t kVersionEnd = 8;
// NumPy aligns the data so.
constexpr size_t kAlignment = 64;

struct NpyHeader {
  std::string type;  // kind and size, e.g. "f4"
  bool is_big_endian = false;
  bool is_fortran_order = false;
  std::vector<uint64_t> shape;
  size_t data_begin = 0;
};

// Reads the Python dictionary of the header: literals of three kinds, in any
// order, as NumPy writes them.
class HeaderParser {
 public:
  explicit HeaderParser(const std::string& text) : text_(text) {}

  // 'descr': '<f4'
  void ParseType(NpyHeader* header) {
    size_t pos = FindValue("descr");
    const size_t end = text_.find('\'', pos + 1);
    if (At(pos) != '\'' || end == std::string::npos || end - pos < 3) {
      throw std::runtime_error("its elements are not plain numbers");
    }
    header->is_big_endian = At(pos + 1) == '>';
    header->type = text_.substr(pos + 2, end - pos - 2);
  }

  // 'fortran_order': False
  void ParseOrder(NpyHeader* header) {
    const size_t pos = FindValue("fortran_order");
    header->is_fortran_order = text_.compare(pos, 4, "True") == 0;
    if (!header->is_fortran_order && text_.compare(pos, 5, "False") != 0) {
      throw std::runtime_error("NumPy header with an unreadable fortran_order");
    }
  }

  // 'shape': (48, 64)
  void ParseShape(NpyHeader* header) {
    size_t pos = FindValue("shape");
    if (At(pos) != '(') Fail();
    for (pos = SkipSpace(pos + 1); At(pos) != ')'; pos = SkipSpace(pos)) {
      uint64_t size = 0;
      const size_t begin = pos;
      for (; std::isdigit(static_cast<unsigned char>(At(pos))); ++pos) {
        if (pos - begin >= 9) Fail();
        size = 10 * size + (At(pos) - '0');
      }
      if (pos == begin) Fail();
      header->shape.push_back(size);
      pos = SkipSpace(pos);
      if (At(pos) == ',') ++pos;
    }
  }

 private:
  [[noreturn]] static void Fail() {
    throw std::runtime_error("NumPy header with an unreadable shape");
  }

  char At(size_t pos) const { return pos < text_.size() ? text_[pos] : '\0'; }

  size_t SkipSpace(size_t pos) const {
    while (At(pos) == ' ') ++pos;
    return pos;
  }

  size_t FindValue(const std::string& key) const {
    const std::string quoted_key = "'" + key + "':";
    const size_t pos = text_.find(quoted_key);
    if (pos == std::string::npos) {
      throw std::runtime_error("NumPy header without " + key);
    }
    return SkipSpace(pos + quoted_key.size());
  }

  const std::string& text_;
};

NpyHeader ParseHeader(const std::vector<uint8_t>& bytes) {
  if (bytes.size() < kVersionEnd + 4 ||
      !std::equal(
          kMagic.begin(), kMagic.end(), bytes.begin(), [](char a, uint8_t b) {
            return uint8_t(a) == b;
          })) {
    throw std::runtime_error("not a NumPy array");
  }
  const int version = bytes[kMagic.size()];
  if (version < 1 || version > 3) {
    throw std::runtime_error("NumPy format version " + std::to_string(version) +
                             " is not supported");
  }
  const size_t length_size = version == 1 ? 2 : 4;
  const uint8_t* length = bytes.data() + kVersionEnd;
  const size_t text_begin = kVersionEnd + length_size;
  const size_t text_size =
      version == 1 ? endian_load<uint16_t, 2, order::little>(length)
                   : endian_load<uint32_t, 4, order::little>(length);
  if (text_size > bytes.size() - text_begin) {
    throw std::runtime_error("NumPy header is truncated");
  }
  const std::string text(bytes.begin() + text_begin,
                         bytes.begin() + text_begin + text_size);
  NpyHeader header;
  header.data_begin = text_begin + text_size;
  HeaderParser parser(text);
  parser.ParseType(&header);
  parser.ParseOrder(&header);
  parser.ParseShape(&header);
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

template <typename T, order kOrder>
float LoadNumber(const uint8_t* data) {
  if constexpr (std::is_same_v<T, Eigen::half>) {
    return HalfToFloat(endian_load<uint16_t, 2, kOrder>(data));
  } else {
    return static_cast<float>(endian_load<T, sizeof(T), kOrder>(data));
  }
}

template <typename T, order kOrder>
void LoadNumbers(const uint8_t* data, std::vector<float>* values) {
  if constexpr (std::is_same_v<T, float> && kOrder == order::native) {
    if (!values->empty()) {
      std::memcpy(values->data(), data, sizeof(float) * values->size());
    }
    return;
  }
  for (float& value : *values) {
    value = LoadNumber<T, kOrder>(data);
    data += sizeof(T);
  }
}

using Loader = void (*)(const uint8_t*, std::vector<float>*);
struct ElementType {
  size_t size;
  Loader load_little_endian;
  Loader load_big_endian;
};

template <typename T>
constexpr ElementType CreateElementType() {
  return {sizeof(T), LoadNumbers<T, order::little>, LoadNumbers<T, order::big>};
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

std::string FormatHeader(const std::string& type, const DepthGrid& grid) {
  std::string text =
      "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" +
      std::to_string(grid.height) + ", " + std::to_string(grid.width) + "), }";
  const size_t unpadded_size = kVersionEnd + 2 + text.size() + 1;
  text.append((kAlignment - unpadded_size % kAlignment) % kAlignment, ' ');
  text.push_back('\n');

  std::string header = kMagic + std::string("\x01\x00", 2);
  header.push_back(static_cast<char>(text.size() & 0xff));
  header.push_back(static_cast<char>(text.size() >> 8));
  return header + text;
}

}  // namespace

NumberArray ParseNpy(const std::vector<uint8_t>& bytes) {
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
  NumberArray array = {header.shape, std::vector<float>(num_values)};
  const Loader load =
      header.is_big_endian ? type.load_big_endian : type.load_little_endian;
  load(bytes.data() + header.data_begin, &array.values);
  if (header.is_fortran_order) {
    array.values = ReorderFortran(array.values, array.shape);
  }
  return array;
}

std::vector<float> HalfsToFloats(const std::vector<uint8_t>& bytes) {
  std::vector<float> values(bytes.size() / 2);
  LoadNumbers<Eigen::half, order::little>(bytes.data(), &values);
  return values;
}

std::vector<uint8_t> FormatNpyHalf(const DepthGrid& grid) {
  const std::string header = FormatHeader("<f2", grid);
  std::vector<uint8_t> bytes(header.begin(), header.end());
  bytes.resize(header.size() + 2 * grid.values.size());
  uint8_t* data = bytes.data() + header.size();
  for (const float value : grid.values) {
    endian_store<uint16_t, 2, order::little>(
        data, Eigen::numext::bit_cast<uint16_t>(Eigen::half(value)));
    data += 2;
  }
  return bytes;
}

std::vector<uint8_t> FormatNpyFloat(const DepthGrid& grid) {
  const std::string header = FormatHeader("<f4", grid);
  std::vector<uint8_t> bytes(header.begin(), header.end());
  bytes.resize(header.size() + 4 * grid.values.size());
  uint8_t* data = bytes.data() + header.size();
  for (const float value : grid.values) {
    endian_store<float, 4, order::little>(data, value);
    data += 4;
  }
  return bytes;
}

}  // namespace dgsfm::internal
