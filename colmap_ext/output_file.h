// Files and folders that commands write. Each is written beside its place,
// synced and renamed: its name stands for the old content or for the whole new
// one, after a crash and on a full disk too. A symbolic link is replaced, what
// it points to stays. All functions throw std::runtime_error naming the file.

#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace dgsfm {

// The path of an image, or of what belongs to it, below a folder. Names come
// out of databases and models: one that is empty, absolute or has a part ".."
// is refused.
std::string PathInside(const std::string& folder, const std::string& name);

class OutputFile {
 public:
  explicit OutputFile(const std::string& path);
  // Without Commit() nothing is left of the file.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void Write(std::string_view bytes);
  // In the byte order of the machine, which sqlite.cc checks to be little.
  template <typename T>
  void WriteNumber(T value) {
    static_assert(std::is_arithmetic_v<T>, "padding bytes are undefined");
    Write({reinterpret_cast<const char*>(&value), sizeof(T)});
  }
  void Commit();

 private:
  void Flush();

  const std::string path_;
  // Where the bytes go before Commit(); empty for a device, pipe or open file,
  // which is written to directly.
  std::string partial_path_;
  int descriptor_ = -1;
  std::string buffer_;
};

void WriteFile(const std::string& path, std::string_view bytes);

// Moves a complete file, written beside its place, to `path`.
void ReplaceFile(const std::string& partial_path, const std::string& path);

// Moves a complete folder to `path`. What was there is in its place then, or
// beside it under the same name with ".old".
void ReplaceFolder(const std::string& folder, const std::string& path);

}  // namespace dgsfm
