// `model_renderer`: a picture of a sparse model, without any graphics driver.

#pragma once

#include "colmap_ext/model/model_io.h"

#include <colmap/util/bitmap.h>

#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// Draws the points in their colours and the cameras as frusta, seen from
// behind and above the cameras, with their mean up direction up. The picture
// frames all cameras and the bulk of the points. Deterministic.
//
// @param cameras        Those of the images; an image without its camera here
//                       is drawn with a field of view of its own.
// @param width, height  Size of the picture, positive [px].
colmap::Bitmap RenderModel(
    const std::map<std::string, ModelImage>& images,
    const std::map<colmap::camera_t, colmap::Camera>& cameras,
    const std::vector<ModelPoint>& points,
    int width,
    int height);

}  // namespace dgsfm
