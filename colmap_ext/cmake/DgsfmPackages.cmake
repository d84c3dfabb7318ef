# What cpack makes (`cpack --config build/release/CPackConfig.cmake`, see
# docs/packages.md): a Debian package and a tarball that runs from any folder.
# Both have the program, man pages and completions, and no development files.

set(CPACK_PACKAGE_NAME dgsfm)
set(CPACK_PACKAGE_VENDOR "the dgsfm authors")
set(CPACK_PACKAGE_CONTACT "the dgsfm authors <dgsfm@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY
    "depth-guided structure from motion for COLMAP")
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_GENERATOR "DEB;TGZ")
set(CPACK_INSTALL_CMAKE_PROJECTS
    "${PROJECT_BINARY_DIR};${PROJECT_NAME};program;/")
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_STRIP_FILES ON)
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/packaging/cpack_options.cmake)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/packaging/arrange.cmake)
# For the scripts of packaging/.
set(CPACK_DGSFM_SOURCE_DIR ${PROJECT_SOURCE_DIR})

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# It extracts and matches features.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS colmap)
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"Camera poses and sparse points from unordered photos, made robust and
metric by depth maps. It reads COLMAP databases, keeps depth priors in
extra tables of them, and writes COLMAP models. Other commands are handed
to the COLMAP on the machine.")
include(CPack)
