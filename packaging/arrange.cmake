# Arranges the installed files of a package.
#
# The Debian package must not have /usr/bin/colmap, which is COLMAP's: the
# program is /usr/bin/dgsfm, and /usr/lib/dgsfm/bin/colmap for scripts that put
# that folder first in PATH. The tarball gets the shared libraries.

set(ROOT ${CPACK_TEMPORARY_INSTALL_DIRECTORY})

function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# Man pages and completions are those of the name that users type.
function(arrange_debian_package)
  set(USR ${ROOT}/usr)
  file(MAKE_DIRECTORY ${USR}/lib/dgsfm/bin)
  file(RENAME ${USR}/bin/colmap ${USR}/lib/dgsfm/bin/colmap)
  file(CREATE_LINK ../lib/dgsfm/bin/colmap ${USR}/bin/dgsfm SYMBOLIC)
  file(REMOVE_RECURSE ${USR}/share/man ${USR}/share/bash-completion
       ${USR}/share/zsh)
  set(DOCUMENTS ${ROOT}-documents)
  run(${USR}/lib/dgsfm/bin/colmap command_documents
      --output_path ${DOCUMENTS} --program dgsfm)
  file(GLOB PAGES ${DOCUMENTS}/man1/*)
  run(gzip --best --no-name ${PAGES})
  file(COPY ${DOCUMENTS}/man1 DESTINATION ${USR}/share/man)
  file(MAKE_DIRECTORY ${USR}/share/bash-completion/completions
       ${USR}/share/zsh/vendor-completions)
  file(RENAME ${DOCUMENTS}/dgsfm.bash
       ${USR}/share/bash-completion/completions/dgsfm)
  file(RENAME ${DOCUMENTS}/_dgsfm ${USR}/share/zsh/vendor-completions/_dgsfm)
  file(REMOVE_RECURSE ${DOCUMENTS})
  set(DOC ${USR}/share/doc/dgsfm)
  file(COPY ${CPACK_DGSFM_SOURCE_DIR}/README.md
            ${CPACK_DGSFM_SOURCE_DIR}/packaging/copyright
            ${CPACK_DGSFM_SOURCE_DIR}/packaging/changelog DESTINATION ${DOC})
  run(gzip --best --no-name ${DOC}/changelog)
endfunction()

function(arrange_tarball)
  run(${CPACK_DGSFM_SOURCE_DIR}/packaging/bundle_libraries.sh
      ${ROOT}/bin/colmap ${ROOT}/lib)
  file(CREATE_LINK colmap ${ROOT}/bin/dgsfm SYMBOLIC)
  file(COPY ${CPACK_DGSFM_SOURCE_DIR}/README.md ${CPACK_DGSFM_SOURCE_DIR}/LICENSE
       DESTINATION ${ROOT})
endfunction()

if(CPACK_GENERATOR STREQUAL "DEB")
  arrange_debian_package()
else()
  arrange_tarball()
endif()
