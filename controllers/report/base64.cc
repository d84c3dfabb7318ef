#include "controllers/report/base64.h"

#include <cstddef>
#include <cstdint>

namespace dgsfm {

std::string ToBase64(std::string_view bytes) {
  constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t block = 0;
    for (size_t j = 0; j < 3; ++j) {
      const uint8_t byte = i + j < bytes.size() ? bytes[i + j] : 0;
      block = block << 8 | byte;
    }
    for (size_t j = 0; j < 4; ++j) {
      text += i + j <= bytes.size() ? kDigits[block >> (18 - 6 * j) & 63] : '=';
    }
  }
  return text;
}

}  // namespace dgsfm
