#include "colmap_ext/formats/hdf5_library.h"

#include "colmap_ext/formats/depth_file_formats.h"

#include <filesystem>
#include <set>
#include <stdexcept>

#ifdef DGSFM_HAS_HDF5
#include <hdf5.h>
#endif

namespace dgsfm::internal {

#ifdef DGSFM_HAS_HDF5

namespace {

constexpr int kMaxNumDimensions = 5;

// An identifier and the function that gives it back.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

struct Search {
  std::string name;
  std::set<std::string> groups;
};

// Called for each object of the file with its path from the root.
herr_t OnObject(hid_t, const char* path, const H5O_info_t* info, void* data) {
  auto* search = static_cast<Search*>(data);
  if (info->type != H5O_TYPE_DATASET) return 0;
  const std::string text = path;
  const size_t slash = text.rfind('/');
  if (slash == std::string::npos) return 0;
  if (search->name.empty() || text.substr(slash + 1) == search->name) {
    search->groups.insert(text.substr(0, slash));
  }
  return 0;
}

// Links, virtual data sets and external storage lead to any file there is.
bool IsInFile(hid_t file, hid_t dataset) {
  H5O_info_t file_info, info;
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  return H5Oget_info(file, &file_info) >= 0 &&
         H5Oget_info(dataset, &info) >= 0 && info.fileno == file_info.fileno &&
         H5Pget_layout(creation) != H5D_VIRTUAL &&
         H5Pget_external_count(creation) == 0;
}

std::vector<uint64_t> ReadShape(hid_t space) {
  const int num_dimensions = space < 0 ? -1 : H5Sget_simple_extent_ndims(space);
  if (num_dimensions < 0 || num_dimensions > kMaxNumDimensions) {
    throw std::runtime_error(std::to_string(num_dimensions) + " dimensions");
  }
  // libhdf5 writes as many numbers as there are dimensions.
  hsize_t sizes[kMaxNumDimensions] = {};
  H5Sget_simple_extent_dims(space, sizes, nullptr);
  return {sizes, sizes + num_dimensions};
}

// The numbers in the given type of libhdf5, whose elements are those of T.
template <typename T>
std::vector<T> ReadAs(hid_t dataset, hid_t type, uint64_t count) {
  std::vector<T> values(count);
  if (H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) <
      0) {
    throw std::runtime_error("unreadable");
  }
  return values;
}

// Little-endian IEEE halfs, for which libhdf5 has no name.
bool IsHalf(hid_t type) {
  size_t sign = 0, exponent = 0, exponent_size = 0, mantissa = 0,
         mantissa_size = 0;
  return H5Tget_class(type) == H5T_FLOAT && H5Tget_size(type) == 2 &&
         H5Tget_order(type) == H5T_ORDER_LE && H5Tget_ebias(type) == 15 &&
         H5Tget_norm(type) == H5T_NORM_IMPLIED &&
         H5Tget_fields(type,
                       &sign,
                       &exponent,
                       &exponent_size,
                       &mantissa,
                       &mantissa_size) >= 0 &&
         sign == 15 && exponent == 10 && exponent_size == 5 && mantissa == 0 &&
         mantissa_size == 10;
}

std::vector<float> ReadValues(hid_t dataset, hid_t type, uint64_t count) {
  const H5T_class_t type_class = type < 0 ? H5T_NO_CLASS : H5Tget_class(type);
  // NumPy's booleans are an enumeration of bytes there.
  if (type_class == H5T_ENUM && H5Tget_size(type) == 1) {
    const auto bytes = ReadAs<uint8_t>(dataset, type, count);
    return {bytes.begin(), bytes.end()};
  }
  if (type_class != H5T_FLOAT && type_class != H5T_INTEGER) {
    throw std::runtime_error("no numbers");
  }
  // libhdf5 takes 20 times as long to convert them.
  if (IsHalf(type)) {
    return HalfsToFloats(ReadAs<uint16_t>(dataset, type, count));
  }
  return ReadAs<float>(dataset, H5T_NATIVE_FLOAT, count);
}

}  // namespace

struct Hdf5Library::Impl {
  explicit Impl(const std::string& path) {
    // Otherwise libhdf5 prints its errors.
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    id = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
    if (id < 0) throw std::runtime_error("no readable HDF5 file");
    std::error_code error;
    file_size = std::filesystem::file_size(path, error);
  }
  ~Impl() { H5Fclose(id); }

  hid_t id = -1;
  uint64_t file_size = 0;
};

Hdf5Library::Hdf5Library(const std::string& path)
    : impl_(std::make_unique<Impl>(path)) {}

Hdf5Library::~Hdf5Library() = default;

std::vector<std::string> Hdf5Library::FindGroups(
    const std::string& name) const {
  Search search = {name, {}};
  if (H5Ovisit(impl_->id, H5_INDEX_NAME, H5_ITER_NATIVE, OnObject, &search) <
      0) {
    throw std::runtime_error("damaged HDF5 file");
  }
  return {search.groups.begin(), search.groups.end()};
}

std::optional<NumberArray> Hdf5Library::Read(const std::string& group,
                                             const std::string& name) const {
  const Handle parent(H5Gopen2(impl_->id, group.c_str(), H5P_DEFAULT),
                      H5Gclose);
  if (parent < 0 || H5Lexists(parent, name.c_str(), H5P_DEFAULT) <= 0) {
    return std::nullopt;
  }
  const std::string array = "the data set " + group + "/" + name;
  const Handle dataset(H5Dopen2(parent, name.c_str(), H5P_DEFAULT), H5Dclose);
  if (dataset < 0) throw std::runtime_error(array + ": unreadable");
  if (!IsInFile(impl_->id, dataset)) {
    throw std::runtime_error(array + ": its numbers are in another file");
  }
  const Handle type(H5Dget_type(dataset), H5Tclose);
  const Handle space(H5Dget_space(dataset), H5Sclose);
  try {
    NumberArray result = {ReadShape(space), {}};
    CheckExpansion(CountValues(result.shape), impl_->file_size);
    result.values = ReadValues(dataset, type, CountValues(result.shape));
    return result;
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(array + ": " + error.what());
  }
}

#else  // DGSFM_HAS_HDF5

struct Hdf5Library::Impl {};

Hdf5Library::Hdf5Library(const std::string&) {
  throw std::runtime_error(
      "this program was built without HDF5: install libhdf5-dev and build it "
      "again, or convert the file to .npz");
}

Hdf5Library::~Hdf5Library() = default;

std::vector<std::string> Hdf5Library::FindGroups(const std::string&) const {
  return {};
}

std::optional<NumberArray> Hdf5Library::Read(const std::string&,
                                             const std::string&) const {
  return std::nullopt;
}

#endif  // DGSFM_HAS_HDF5

}  // namespace dgsfm::internal
