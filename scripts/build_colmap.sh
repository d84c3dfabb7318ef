#!/usr/bin/env bash
# Builds COLMAP 3.8 as this project needs it:
#
#   build_colmap.sh [--core | --full]   builds and installs it, unless that has
#                                       been done; the last line of the output
#                                       is the folder of the installation
#   build_colmap.sh --source FOLDER     extracts the unpatched source there
#
# The source is that of Debian's source package, changed by
# patches/colmap-3.8/series. It is downloaded once by apt, or is the file
# colmap_3.8.orig.tar.gz that the environment variable DGSFM_COLMAP_ARCHIVE
# names: then neither apt nor a network is needed.
# --core (default) leaves out what a mapper does not need, --full builds all
# but GUI, OpenGL, CUDA and CGAL. Installations live in the user's cache
# folder, named after all that determines them: version, variant, patches,
# libraries, compiler and its flags (environment: CC, CXX, CXXFLAGS).
# Exit code 3 means that the source could not be obtained.
set -euo pipefail

version=3.8-1
sha256=02288f8f61692fe38049d65608ed832b31246e7792692376afb712fa4cef8775

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
patches=$root/patches/colmap-3.8
cache=${XDG_CACHE_HOME:-$HOME/.cache}/dgsfm
archive_name=colmap_${version%-*}.orig.tar.gz
source_archive=${DGSFM_COLMAP_ARCHIVE:-$cache/colmap-$version/$archive_name}
cxx=${CXX:-c++}
export CXX=$cxx CC=${CC:-cc} CXXFLAGS=${CXXFLAGS:-}
export CFLAGS=$CXXFLAGS

log() { echo "$@" >&2; }

# Debian applies no patches to this version: its "series" is all comments.
extract_source() {
  local is_valid="sha256sum --check --status --ignore-missing"
  if [[ -n ${DGSFM_COLMAP_ARCHIVE:-} ]]; then
    if ! $is_valid <<<"$sha256  $source_archive"; then
      log "ERROR: DGSFM_COLMAP_ARCHIVE=$source_archive is not $archive_name of" \
        "Debian's source package colmap $version (SHA-256 $sha256)"
      exit 3
    fi
  elif ! $is_valid <<<"$sha256  $source_archive"; then
    log "Downloading the source of COLMAP $version"
    rm -rf "$(dirname "$source_archive")"
    "$root/scripts/apt_source.sh" "colmap=$version" \
      "$(dirname "$source_archive")" || {
      log "Without apt, get $archive_name of Debian's source package colmap" \
        "$version (SHA-256 $sha256) elsewhere and name it in" \
        "DGSFM_COLMAP_ARCHIVE; or name an installed COLMAP in COLMAP_DIR"
      exit 3
    }
    if ! $is_valid <<<"$sha256  $source_archive"; then
      log "ERROR: $source_archive has a wrong checksum"
      exit 3
    fi
  fi
  mkdir -p "$1"
  tar --extract --gzip --file "$source_archive" --directory "$1" \
    --strip-components 1
}

apply_patches() {
  local name
  while read -r name; do
    patch --directory "$1" --strip 1 --batch --fuzz 0 --silent \
      <"$patches/$name" >&2
  done <"$patches/series"
}

# The versions of the libraries that COLMAP is built with.
library_versions() {
  if command -v dpkg-query >/dev/null; then
    dpkg-query --show libboost-dev libceres-dev libeigen3-dev \
      libfreeimage-dev libgoogle-glog-dev libsqlite3-dev 2>/dev/null || true
  else
    pkg-config --modversion eigen3 libglog sqlite3
    # shellcheck disable=SC2086
    "$CXX" $CXXFLAGS -x c++ -E -dM -include boost/version.hpp \
      -include ceres/version.h /dev/null | grep -E 'BOOST_VERSION|CERES_VERSION'
  fi
}

# A line for every tenth of the steps that Ninja's lines on stdin count. (awk may
# wait for more of them before it shows any.)
show_progress() {
  local line tenth shown=0 start=$SECONDS
  while IFS= read -r line; do
    if [[ $line =~ ^\[([0-9]+)/([0-9]+)\] ]]; then
      tenth=$((10 * BASH_REMATCH[1] / BASH_REMATCH[2]))
      if [[ $tenth -gt $shown ]]; then
        shown=$tenth
        log "  $((10 * tenth)) % after $((SECONDS - start)) s"
      fi
    fi
  done
}

flags=(-DCMAKE_BUILD_TYPE=Release -DBOOST_STATIC=OFF -DCGAL_ENABLED=OFF
  -DCUDA_ENABLED=OFF -DGUI_ENABLED=OFF -DIPO_ENABLED=OFF -DOPENGL_ENABLED=OFF)
case ${1:---core} in
  # OpenMP would only make Eigen's products depend on the number of threads.
  --core) flags+=(-DCORE_ONLY=ON -DOPENMP_ENABLED=OFF) ;;
  --full) flags+=(-DCORE_ONLY=OFF) ;;
  --source)
    extract_source "${2:?usage: build_colmap.sh --source FOLDER}"
    exit
    ;;
  *)
    log "usage: build_colmap.sh [--core | --full | --source FOLDER]"
    exit 2
    ;;
esac

key=$({
  echo "$version" "${flags[@]}" "$CXXFLAGS"
  cat "$patches/series" "$patches"/*.patch
  library_versions
  # The compiler's version, target and what its flags stand for.
  # shellcheck disable=SC2086
  "$cxx" $CXXFLAGS -x c++ -E -dM /dev/null
} | sha256sum | cut -c1-16)
prefix=$cache/colmap-${version%-*}-$key

# Installations appear whole, so only building needs the lock.
if [[ ! -d $prefix ]]; then
  mkdir -p "$cache"
  exec 9>"$cache/lock"
  if ! flock --nonblock 9; then
    log "Waiting for another build of COLMAP"
    flock 9
  fi
fi

if [[ ! -d $prefix ]]; then
  rm -rf "$cache"/build.*
  work=$(mktemp -d "$cache/build.XXXXXX")
  trap 'rm -rf "$work"' EXIT
  extract_source "$work/source"
  apply_patches "$work/source"
  build_log=$cache/build.log
  log "Building COLMAP ${version%-*}: some minutes, once (log: $build_log)"
  if ! { cmake -S "$work/source" -B "$work/build" -G Ninja "${flags[@]}" \
           -DCMAKE_INSTALL_PREFIX="$work/install" &&
         cmake --build "$work/build" &&
         cmake --install "$work/build"; } 2>&1 9>&- |
    tee "$build_log" | show_progress; then
    tail -n 50 "$build_log" >&2
    log "ERROR: COLMAP does not build, see $build_log"
    exit 1
  fi
  mv "$work/install" "$prefix"
fi
echo "$prefix"
