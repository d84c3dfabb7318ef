# Installs the package that find_package(dgsfm) reads. A COLMAP that we built
# goes along, so that the installation does not depend on a cache folder.

include(CMakePackageConfigHelpers)

set(PACKAGE_FOLDER ${CMAKE_INSTALL_LIBDIR}/cmake/dgsfm)
if(COLMAP_PREFIX)
  install(DIRECTORY ${COLMAP_PREFIX}/
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/dgsfm/colmap-3.8)
  set(COLMAP_PACKAGE_PATH
      ${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_LIBDIR}/dgsfm/colmap-3.8)
else()
  set(COLMAP_PACKAGE_PATH ${COLMAP_DIR})
endif()

configure_package_config_file(
  ${CMAKE_CURRENT_LIST_DIR}/dgsfmConfig.cmake.in
  ${PROJECT_BINARY_DIR}/dgsfmConfig.cmake
  INSTALL_DESTINATION ${PACKAGE_FOLDER} PATH_VARS COLMAP_PACKAGE_PATH)
write_basic_package_version_file(
  ${PROJECT_BINARY_DIR}/dgsfmConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/dgsfmConfig.cmake
              ${PROJECT_BINARY_DIR}/dgsfmConfigVersion.cmake
              ${CMAKE_CURRENT_LIST_DIR}/DgsfmColmap.cmake
        DESTINATION ${PACKAGE_FOLDER})
install(EXPORT dgsfm FILE dgsfmTargets.cmake NAMESPACE dgsfm::
        DESTINATION ${PACKAGE_FOLDER})
