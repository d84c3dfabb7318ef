// A program of somebody else that uses the installed libraries: one header of
// each layer and one of COLMAP.

#include "colmap_ext/rigid3.h"
#include "controllers/commands/commands.h"
#include "estimators/averaging/graph.h"
#include "sfm/view_graph/view_graph.h"

#include <colmap/base/reconstruction.h>

#include <iostream>

int main() {
  const colmap::Reconstruction reconstruction;
  const dgsfm::Rigid3d identity;
  std::cout << reconstruction.NumImages() << " images, "
            << identity.translation.norm() << " from the origin\n";
  for (const dgsfm::Command& command : dgsfm::Commands()) {
    std::cout << command.name << "\n";
  }
}
