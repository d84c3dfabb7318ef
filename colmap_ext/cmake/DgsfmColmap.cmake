# COLMAP 3.8 exports variables only: turns them into one target. Its headers
# are included as <colmap/base/image.h>. Also part of the installed package.

if(NOT TARGET dgsfm::colmap38)
  add_library(dgsfm::colmap38 INTERFACE IMPORTED GLOBAL)
  target_include_directories(dgsfm::colmap38 SYSTEM INTERFACE
                             ${COLMAP_INCLUDE_DIRS})
  foreach(NAME ${COLMAP_LIBRARIES})
    # By path: "colmap" may also be the name of a target.
    unset(FOUND_PATH)
    find_library(FOUND_PATH ${NAME} PATHS ${COLMAP_LINK_DIRS}
                 NO_DEFAULT_PATH NO_CACHE)
    if(FOUND_PATH)
      set(NAME ${FOUND_PATH})
    endif()
    target_link_libraries(dgsfm::colmap38 INTERFACE ${NAME})
  endforeach()
endif()
