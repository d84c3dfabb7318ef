# Third-party packages, and COLMAP 3.8 as the target dgsfm::colmap38.

find_package(Boost REQUIRED COMPONENTS program_options filesystem system)
# OpenBLAS factorises several times faster than the ATLAS of Debian's Ceres.
find_library(OPENBLAS_LIBRARY openblas)
if(BLA_VENDOR)
  message(STATUS "BLAS: ${BLA_VENDOR}")
elseif(OPENBLAS_LIBRARY)
  set(BLA_VENDOR OpenBLAS)
else()
  message(STATUS "No OpenBLAS: large models will take longer")
endif()
find_package(Ceres REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(OpenEXR REQUIRED)
find_package(PNG REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(TIFF REQUIRED)
find_package(ZLIB REQUIRED)
find_package(nlohmann_json REQUIRED)
# libzip's own package file needs its command-line tools installed.
find_package(PkgConfig REQUIRED)
pkg_check_modules(LIBZIP REQUIRED IMPORTED_TARGET GLOBAL libzip)
pkg_check_modules(LIBISAL REQUIRED IMPORTED_TARGET GLOBAL libisal)
pkg_search_module(HDF5 IMPORTED_TARGET GLOBAL hdf5-serial hdf5)
if(NOT HDF5_FOUND)
  message(STATUS "No libhdf5: depth and matches in HDF5 files are refused")
endif()

# COLMAP_DIR takes an installed COLMAP 3.8, built as C++17. Without it we build
# one, or find the one that was built before.
if(COLMAP_DIR)
  find_package(COLMAP 3.8 REQUIRED CONFIG)
else()
  # Eigen's memory layout follows the machine flags, so COLMAP gets ours.
  string(REGEX MATCHALL "(^| )-m[^ ]+" MACHINE_FLAGS "${CMAKE_CXX_FLAGS}")
  list(JOIN MACHINE_FLAGS " " MACHINE_FLAGS)
  if(DGSFM_BUILD_FORK)
    set(VARIANT --full)
  else()
    set(VARIANT --core)
  endif()
  execute_process(
    COMMAND ${CMAKE_COMMAND} -E env CC=${CMAKE_C_COMPILER}
            CXX=${CMAKE_CXX_COMPILER} CXXFLAGS=${MACHINE_FLAGS}
            ${PROJECT_SOURCE_DIR}/scripts/build_colmap.sh ${VARIANT}
    OUTPUT_VARIABLE COLMAP_PREFIX OUTPUT_STRIP_TRAILING_WHITESPACE
    COMMAND_ERROR_IS_FATAL ANY)
  file(GLOB PATCHES CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/patches/*/*)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS
               ${PATCHES} ${PROJECT_SOURCE_DIR}/scripts/build_colmap.sh)
  find_package(COLMAP 3.8 REQUIRED CONFIG
               PATHS ${COLMAP_PREFIX} NO_DEFAULT_PATH)
  # COLMAP_DIR in the cache is the user's alone.
  set(BUILT_COLMAP_DIR ${COLMAP_DIR})
  unset(COLMAP_DIR CACHE)
  set(COLMAP_DIR ${BUILT_COLMAP_DIR})
endif()
include(DgsfmColmap)
