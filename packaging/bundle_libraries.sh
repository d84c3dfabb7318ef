#!/usr/bin/env bash
# Makes a program run from any folder on machines that lack its libraries:
#
#   bundle_libraries.sh PROGRAM FOLDER
#
# copies the shared libraries that it needs, directly or not, into the folder,
# and makes all of them look for each other there. The C library stays with the
# machine, as loader and name service belong to it, and so does the C++ library:
# that of the building machine may need a newer C library than all others do.
# Licences of Debian packages that the libraries are from go to FOLDER/licenses.
set -euo pipefail

if [[ $# -ne 2 ]]; then
  echo "usage: bundle_libraries.sh PROGRAM FOLDER" >&2
  exit 2
fi
program=$1
folder=$2
if ! command -v patchelf >/dev/null; then
  echo "ERROR: patchelf is not installed (package patchelf)" >&2
  exit 1
fi

of_machine='^(ld-linux.*|lib(c|m|dl|rt|pthread|resolv|util|stdc\+\+|gcc_s))\.so\.'
mkdir -p "$folder/licenses"
ldd "$program" | awk '$2 == "=>" {print $1, $3}' |
  while read -r name path; do
    if [[ $name =~ $of_machine ]]; then
      continue
    fi
    if [[ $path != /* ]]; then
      echo "ERROR: $program needs $name, which is not found" >&2
      exit 1
    fi
    cp --dereference "$path" "$folder/$name"
    chmod 644 "$folder/$name"
    patchelf --force-rpath --set-rpath "\$ORIGIN" "$folder/$name"
    # Debian lists the file by its real path, with or without /usr.
    real=$(readlink -f "$path")
    package=$(dpkg-query --search "$real" "${real#/usr}" 2>/dev/null |
      head -n 1 | cut -d: -f1 || true)
    if [[ -n $package && -f /usr/share/doc/$package/copyright ]]; then
      cp --dereference "/usr/share/doc/$package/copyright" \
        "$folder/licenses/$package"
    fi
  done
patchelf --force-rpath --set-rpath \
  "\$ORIGIN/$(realpath --relative-to "$(dirname "$program")" "$folder")" \
  "$program"
