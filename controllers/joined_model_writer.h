// Joined models on disk, of images that need not fit into memory.

#pragma once

#include "sfm/joining/joined_model.h"

#include <string>
#include <vector>

namespace dgsfm {

// Writes a joined model as WriteModel() does, but the images in the order of
// the parts: each with all key points of the first part that has it, which are
// read from that part's folder, and those added to them. Memory beside the
// model is that of the key points of one image. Throws std::runtime_error
// naming the file.
void WriteJoinedModel(const JoinedModel& model,
                      const std::vector<PartModel>& parts,
                      const AddedKeypoints& added_keypoints,
                      const std::string& folder);

}  // namespace dgsfm
