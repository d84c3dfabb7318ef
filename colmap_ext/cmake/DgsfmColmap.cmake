# COLMAP 3.8 exports variables only: turns them into one target. Its headers
# are included as <colmap/base/image.h>. Also part of the installed package.

if(NOT TARGET dgsfm::colmap38)
  # By path, as "colmap" may also be the name of a target. The first folder is
  # COLMAP's own.
  list(GET COLMAP_LINK_DIRS 0 COLMAP_LIBRARY_DIR)
  set(COLMAP_LIBRARY_PATHS)
  foreach(NAME ${COLMAP_LIBRARIES})
    unset(LIBRARY_PATH)
    find_library(LIBRARY_PATH ${NAME} PATHS ${COLMAP_LIBRARY_DIR}
                 NO_DEFAULT_PATH NO_CACHE)
    if(LIBRARY_PATH)
      list(APPEND COLMAP_LIBRARY_PATHS ${LIBRARY_PATH})
    else()
      list(APPEND COLMAP_LIBRARY_PATHS ${NAME})
    endif()
  endforeach()
  list(POP_FRONT COLMAP_LIBRARY_PATHS LIBRARY_PATH)

  add_library(dgsfm::colmap38 UNKNOWN IMPORTED GLOBAL)
  set_target_properties(dgsfm::colmap38 PROPERTIES
    IMPORTED_LOCATION ${LIBRARY_PATH}
    INTERFACE_LINK_LIBRARIES "${COLMAP_LIBRARY_PATHS}"
    INTERFACE_LINK_DIRECTORIES "${COLMAP_LINK_DIRS}"
    INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${COLMAP_INCLUDE_DIRS}"
    INTERFACE_INCLUDE_DIRECTORIES "${COLMAP_INCLUDE_DIRS}")
endif()
