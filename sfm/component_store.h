// What mapping a component comes to, so that a run that was broken off need not
// map it again.

#pragma once

#include "sfm/mapping/component_mapping.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

using ImageIds = std::vector<colmap::image_t>;

// What mapping leaves of a pair of the component.
struct PairOutcome {
  PairStatus status = PairStatus::NO_GEOMETRY;
  std::vector<PairVerdict> verdicts;
  uint32_t degeneracies = 0;
  bool has_scale = false;
  size_t num_matches = 0;
  size_t num_inliers = 0;
  // Whether the inliers themselves are still there.
  bool has_inliers = false;
};

struct MappedComponent {
  ComponentResult result;
  // Images that rotation averaging cut off: components of their own.
  std::vector<ImageIds> other_parts;
  std::map<colmap::image_pair_t, PairOutcome> pairs;
  MappingLog log;
};

// Keeps mapped components beyond the end of the program.
class ComponentStore {
 public:
  virtual ~ComponentStore() = default;
  // The component of these images, if a run with the same input and options
  // mapped it.
  virtual std::optional<MappedComponent> Find(const ImageIds& image_ids) = 0;
  virtual void Keep(const ImageIds& image_ids,
                    const MappedComponent& component) = 0;
};

// The state of the pairs between the images.
std::map<colmap::image_pair_t, PairOutcome> OutcomesOf(
    const ImageIds& image_ids, const PairGeometries& pairs);

// Brings pairs, as they were before their component was mapped, to the state in
// which it left them, but for geometries that were found anew, which nothing
// reads any more.
void ApplyOutcomes(const std::map<colmap::image_pair_t, PairOutcome>& outcomes,
                   PairGeometries* pairs);

}  // namespace dgsfm
