// The log of a mapping as a story: a sentence for each part of it, with what
// came out and the time it took. The figures of single stages are details.

#pragma once

#include "sfm/stage_report.h"

#include <string>
#include <vector>

namespace dgsfm {

// The sentences that are due once the last of the reports has come, in the
// order of the story; often none. Stages that repeat, as rounds of bundle
// adjustment do, get one sentence, which is due when the next part begins.
// Models after the first get one sentence each.
std::vector<std::string> NextSentences(const std::vector<StageReport>& reports);

// A duration with the precision that a reader needs: "0.4 s", "12 s", "3 min
// 20 s".
std::string DurationText(double seconds);

// "1 image", "1,234 images"; the plural is that of the noun with an s.
std::string CountText(size_t count, const std::string& noun);

}  // namespace dgsfm
