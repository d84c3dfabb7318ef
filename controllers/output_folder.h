// Folders and text files that commands write.

#pragma once

#include <string>

namespace dgsfm {

// Creates the folder with those above it where they are missing. Throws
// std::runtime_error naming it if that fails or it is a file.
void CreateOutputFolder(const std::string& path);

// Throws std::runtime_error naming the file.
void WriteTextFile(const std::string& path, const std::string& text);

}  // namespace dgsfm
