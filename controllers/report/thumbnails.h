// Small pictures of the images for the report page.

#pragma once

#include <string>
#include <vector>

namespace dgsfm {

// JPEG files of the images, in their order and as their pixels lie (whatever
// their EXIF data say of turning, and without that data). More images get
// smaller ones, and together they have at most max_num_bytes: those beyond, and
// of images that cannot be read, are empty, with a warning in the log.
std::vector<std::string> MakeThumbnails(const std::string& image_path,
                                        const std::vector<std::string>& names,
                                        size_t max_num_bytes,
                                        int num_threads);

}  // namespace dgsfm
