#include "python/src/conversion.h"

#include "colmap_ext/formats/depth_file_formats.h"

#include <cstdint>
#include <stdexcept>
#include <utility>
#include <vector>

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

namespace dgsfm {
namespace {

namespace nb = nanobind;
using internal::NumberArray;

// Numbers of an array that somebody else owns.
struct ArrayView {
  const void* data = nullptr;
  nb::dlpack::dtype type;
  std::vector<uint64_t> shape;
  size_t size = 0;
};

template <typename T>
void CopyAs(const ArrayView& view, std::vector<float>* values) {
  const T* numbers = static_cast<const T*>(view.data);
  values->assign(numbers, numbers + view.size);
}

// False for a type that is no number.
bool CopyNumbers(const ArrayView& view, std::vector<float>* values) {
  using Code = nb::dlpack::dtype_code;
  const int bits = view.type.bits;
  switch (static_cast<Code>(view.type.code)) {
    case Code::Float:
      if (bits == 16) {
        const auto* halfs = static_cast<const uint16_t*>(view.data);
        *values = internal::HalfsToFloats({halfs, halfs + view.size});
      }
      if (bits == 32) CopyAs<float>(view, values);
      if (bits == 64) CopyAs<double>(view, values);
      return bits == 16 || bits == 32 || bits == 64;
    case Code::Int:
      if (bits == 8) CopyAs<int8_t>(view, values);
      if (bits == 16) CopyAs<int16_t>(view, values);
      if (bits == 32) CopyAs<int32_t>(view, values);
      if (bits == 64) CopyAs<int64_t>(view, values);
      return true;
    case Code::UInt:
    case Code::Bool:
      if (bits == 8) CopyAs<uint8_t>(view, values);
      if (bits == 16) CopyAs<uint16_t>(view, values);
      if (bits == 32) CopyAs<uint32_t>(view, values);
      if (bits == 64) CopyAs<uint64_t>(view, values);
      return true;
    default:
      return false;
  }
}

NumberArray ToNumbers(const ArrayView& view) {
  NumberArray array;
  array.shape = view.shape;
  if (internal::CountValues(view.shape) == 0) {
    throw std::runtime_error("the array has no values");
  }
  if (!CopyNumbers(view, &array.values)) {
    throw std::runtime_error("the array has no real numbers");
  }
  return array;
}

ArrayView ViewOf(nb::handle object) {
  const auto array =
      nb::cast<nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>>(object);
  ArrayView view;
  view.data = array.data();
  view.type = array.dtype();
  view.size = array.size();
  for (size_t i = 0; i < array.ndim(); ++i)
    view.shape.push_back(array.shape(i));
  return view;
}

// The value in the type that the option has, where Python lets one stand for
// the other.
CommandOptions::Value ToValue(const CommandOptions::Option& option,
                              nb::handle value) {
  const CommandOptions::Value current = option.get();
  if (nb::isinstance<nb::bool_>(value)) return nb::cast<bool>(value);
  if (nb::isinstance<nb::str>(value)) return nb::cast<std::string>(value);
  if (nb::isinstance<nb::int_>(value)) {
    if (std::holds_alternative<double>(current)) return nb::cast<double>(value);
    int number = 0;
    if (!nb::try_cast(value, number)) {
      throw nb::value_error(
          ("option " + option.name + " is out of range").c_str());
    }
    const bool is_truth_value = number == 0 || number == 1;
    if (std::holds_alternative<bool>(current) && is_truth_value) {
      return number == 1;
    }
    return number;
  }
  if (nb::isinstance<nb::float_>(value)) return nb::cast<double>(value);
  return nb::cast<std::string>(nb::str(value));
}

nb::list ToList(const std::vector<std::string>& texts) {
  nb::list list;
  for (const std::string& text : texts) list.append(text);
  return list;
}

nb::dict CountsOf(const PairTotals& totals) {
  nb::dict counts;
  for (const auto& [status, count] : totals.num_with_status) {
    counts[PairStatusName(status).c_str()] = count;
  }
  return counts;
}

}  // namespace

void SetOptions(const nb::dict& values, CommandOptions* options) {
  for (const auto& [key, value] : values) {
    const std::string name = nb::cast<std::string>(key);
    bool is_found = false;
    for (const CommandOptions::Option& option : options->Options()) {
      if (option.name != name) continue;
      is_found = true;
      try {
        option.set(ToValue(option, value));
      } catch (const std::runtime_error& error) {
        throw nb::value_error(error.what());
      }
    }
    if (!is_found) {
      throw nb::value_error(("unrecognised option '" + name + "'").c_str());
    }
  }
}

nb::list DescribeOptions(const CommandOptions& options) {
  nb::list descriptions;
  for (const CommandOptions::Option& option : options.Options()) {
    if (option.is_required) continue;
    const nb::object value = std::visit(
        [](const auto& typed) { return nb::cast(typed); }, option.get());
    descriptions.append(nb::make_tuple(
        option.name, value, option.help, ToList(option.choices)));
  }
  return descriptions;
}

ArrayReader ReaderOf(const nb::dict& arrays) {
  std::map<std::string, ArrayView> views;
  for (const auto& [name, array] : arrays) {
    views[nb::cast<std::string>(name)] = ViewOf(array);
  }
  return [views = std::move(views)](
             const std::string& name) -> std::optional<NumberArray> {
    const auto view = views.find(name);
    if (view == views.end()) return std::nullopt;
    return ToNumbers(view->second);
  };
}

std::map<std::string, ArrayReader> ReadersOf(const nb::dict& groups) {
  std::map<std::string, ArrayReader> readers;
  for (const auto& [group, arrays] : groups) {
    readers[nb::cast<std::string>(group)] =
        ReaderOf(nb::cast<nb::dict>(arrays));
  }
  return readers;
}

std::map<std::string, DepthFile> DepthFilesOf(const nb::dict& depths) {
  std::map<std::string, DepthFile> files;
  for (const auto& [key, depth] : depths) {
    const std::string name = nb::cast<std::string>(key);
    DepthFile& file = files[name];
    if (nb::isinstance<nb::str>(depth)) {
      file.path = nb::cast<std::string>(depth);
    } else {
      file.path = "of " + name;
      file.arrays = ReaderOf(nb::cast<nb::dict>(depth));
    }
  }
  return files;
}

nb::dict ToPython(const DepthImportSummary& summary) {
  nb::list imported;
  size_t num_keypoints_with_depth = 0;
  for (const DepthImportSummary::Image& image : summary.imported) {
    nb::dict entry;
    entry["name"] = image.name;
    entry["width"] = image.width;
    entry["height"] = image.height;
    entry["coverage"] = image.coverage;
    entry["num_keypoints"] = image.num_keypoints;
    entry["num_keypoints_with_depth"] = image.num_keypoints_with_depth;
    entry["median_depth"] = image.median_depth;
    entry["focal_length_px"] = image.focal_length_px;
    num_keypoints_with_depth += image.num_keypoints_with_depth;
    imported.append(entry);
  }
  nb::dict failed;
  for (const DepthImportSummary::Failure& failure : summary.failed) {
    failed[failure.name.c_str()] = failure.reason;
  }
  nb::dict result;
  result["imported"] = imported;
  result["failed"] = failed;
  result["num_unchanged"] = summary.num_unchanged;
  result["num_keypoints_with_depth"] = num_keypoints_with_depth;
  result["images_without_depth"] = ToList(summary.images_without_depth);
  result["depths_without_image"] = ToList(summary.files_without_image);
  return result;
}

nb::dict ToPython(const DenseMatchImportSummary& summary) {
  nb::dict result;
  result["num_pairs"] = summary.num_pairs;
  result["num_matches"] = summary.num_matches;
  result["num_points"] = summary.num_points;
  result["num_keypoints"] = summary.num_keypoints;
  result["num_matches_left_out"] = summary.num_matches_left_out;
  result["groups_without_images"] = ToList(summary.groups_without_images);
  return result;
}

nb::dict ToPython(const VerificationSummary& summary) {
  nb::dict result;
  result["pairs"] = CountsOf(summary.totals);
  result["num_kept"] = summary.num_kept;
  result["num_deleted"] = summary.num_deleted;
  return result;
}

nb::dict ToPython(const GlobalDepthMapperSummary& summary) {
  nb::dict result;
  result["models"] = ToList(summary.model_paths);
  return result;
}

nb::dict ToPython(const DepthExportSummary& summary) {
  nb::dict exported;
  for (const DepthExportSummary::Image& image : summary.exported) {
    nb::dict entry;
    entry["file"] = image.file;
    if (image.alignment) {
      entry["scale"] = image.alignment->scale;
      entry["shift"] = image.alignment->shift;
      entry["num_points"] = image.alignment->num_points;
      entry["scale_residual"] = image.alignment->scale_residual;
      entry["residual"] = image.alignment->residual;
    }
    exported[image.name.c_str()] = entry;
  }
  nb::dict result;
  result["exported"] = exported;
  result["images_without_map"] = ToList(summary.images_without_map);
  result["images_without_model"] = ToList(summary.images_without_model);
  result["images_with_few_points"] = ToList(summary.images_with_few_points);
  return result;
}

}  // namespace dgsfm
