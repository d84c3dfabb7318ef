// Colours of the points of a model from its images.

#pragma once

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <string>

namespace dgsfm {

// Gives each point the mean colour of its observations; black where no image
// can be read, which is logged. JPEG files, whose decoding takes most of the
// time, are decoded at half their size. The same for any number of threads.
//
// @param image_path   Folder of the images.
// @param num_threads  -1 = all cores.
void ExtractPointColors(const std::string& image_path,
                        int num_threads,
                        colmap::Reconstruction* model);

}  // namespace dgsfm
