#include "controllers/image_list.h"

#include <fstream>
#include <stdexcept>

namespace dgsfm {

ImageNames ReadImageList(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read the list of images " + path);
  ImageNames names;
  std::string name;
  while (std::getline(file, name)) {
    if (!name.empty() && name.back() == '\r') name.pop_back();
    if (!name.empty()) names.insert(name);
  }
  if (file.bad()) {
    throw std::runtime_error("cannot read the list of images " + path);
  }
  if (names.empty()) {
    throw std::runtime_error("the list of images " + path + " is empty");
  }
  return names;
}

}  // namespace dgsfm
