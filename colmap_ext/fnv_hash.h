// 64-bit FNV-1a hash, the same on every machine of the same byte order.

#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace dgsfm {

class FnvHash {
 public:
  template <typename T>
  void Add(const T& value) {
    static_assert(std::is_arithmetic_v<T>, "padding bytes are undefined");
    AddBytes(&value, sizeof(T));
  }
  // Number of the values and all of them: a vector or a string.
  template <typename T>
  void AddAll(const T& values) {
    Add(values.size());
    for (const auto& value : values) Add(value);
  }
  uint64_t Value() const { return value_; }

 private:
  void AddBytes(const void* data, size_t num_bytes) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < num_bytes; ++i) {
      value_ = (value_ ^ bytes[i]) * 0x100000001B3ull;
    }
  }

  uint64_t value_ = 0xCBF29CE484222325ull;
};

}  // namespace dgsfm
