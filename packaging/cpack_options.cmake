# Where each kind of package has its files.

if(CPACK_GENERATOR STREQUAL "DEB")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
else()
  set(CPACK_PACKAGE_FILE_NAME
      dgsfm-${CPACK_PACKAGE_VERSION}-linux-${CMAKE_HOST_SYSTEM_PROCESSOR})
  if(NOT CMAKE_HOST_SYSTEM_PROCESSOR)
    cmake_host_system_information(RESULT PLATFORM QUERY OS_PLATFORM)
    set(CPACK_PACKAGE_FILE_NAME
        dgsfm-${CPACK_PACKAGE_VERSION}-linux-${PLATFORM})
  endif()
endif()
