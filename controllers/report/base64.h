// Base64 (RFC 4648), for binary data inside text.

#pragma once

#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace dgsfm {

std::string ToBase64(std::string_view bytes);

// In the byte order of the machine, which sqlite.cc checks to be little.
template <typename T>
std::string ToBase64(const std::vector<T>& values) {
  static_assert(std::is_arithmetic_v<T>, "padding bytes are undefined");
  return ToBase64(std::string_view(reinterpret_cast<const char*>(values.data()),
                                   sizeof(T) * values.size()));
}

}  // namespace dgsfm
