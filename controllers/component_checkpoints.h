// Mapped components on disk, from which a run that is broken off goes on.

#pragma once

#include "sfm/component_store.h"

#include <cstdint>
#include <string>

namespace dgsfm {

// Each component is a folder beside the output, which gets its name once it is
// complete. Those of another key are removed and never used. Where a component
// cannot be written or read there is a warning, and it is mapped again.
class ComponentCheckpoints : public ComponentStore {
 public:
  // The key stands for all input and options of the mapping.
  ComponentCheckpoints(const std::string& output_path, uint64_t key);

  std::optional<MappedComponent> Find(const ImageIds& image_ids) override;
  void Keep(const ImageIds& image_ids,
            const MappedComponent& component) override;
  // Removes all of them, once the run has its output.
  void Remove();

 private:
  std::string FolderOf(const ImageIds& image_ids) const;

  const std::string root_;
  const std::string folder_;
};

}  // namespace dgsfm
