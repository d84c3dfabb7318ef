# Third-party packages, and COLMAP 3.8 as one imported target dgsfm::colmap.

find_package(ZLIB REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(Ceres REQUIRED)
find_package(Boost REQUIRED COMPONENTS program_options filesystem system)
find_package(nlohmann_json REQUIRED)
# libzip's own package file needs its command-line tools installed.
find_package(PkgConfig REQUIRED)
pkg_check_modules(LIBZIP REQUIRED IMPORTED_TARGET GLOBAL libzip)
find_package(COLMAP REQUIRED CONFIG)

add_library(dgsfm_colmap INTERFACE)
target_include_directories(dgsfm_colmap SYSTEM INTERFACE ${COLMAP_INCLUDE_DIRS})
target_link_directories(dgsfm_colmap INTERFACE ${COLMAP_LINK_DIRS})
target_link_libraries(dgsfm_colmap INTERFACE ${COLMAP_LIBRARIES})
