#!/usr/bin/env bash
# Installs the Debian packages that building, testing and the demo need; does
# nothing if they are there. --fork adds those of a full COLMAP, for
# DGSFM_BUILD_FORK, and --packages those of scripts/build_packages.sh. Where
# there is no dpkg, or DGSFM_SKIP_INSTALL is 1, nothing is installed: CMake names
# what it misses.
set -euo pipefail

packages=(
  # Tools. gzip, tar, patch and the like come with build-essential.
  build-essential ca-certificates clang-format-14 cmake git ninja-build
  pkg-config python3 python3-dev python3-venv unzip
  # Libraries of COLMAP's core and of ours.
  libboost-filesystem-dev libboost-program-options-dev libboost-system-dev
  libceres-dev libeigen3-dev libfreeimage-dev libgoogle-glog-dev libhdf5-dev
  libisal-dev libmetis-dev libopenblas-serial-dev libopenexr-dev libpng-dev
  libsqlite3-dev libsuitesparse-dev libtiff-dev libzip-dev nlohmann-json3-dev
  zlib1g-dev
  # Tests.
  libgmock-dev libgtest-dev
  # The program that extracts and matches features.
  colmap
)
if [[ ${1:-} == --packages ]]; then
  packages+=(dpkg-dev file patchelf)
elif [[ ${1:-} == --fork ]]; then
  packages+=(libboost-graph-dev libboost-test-dev libflann-dev libgl-dev
    libglew-dev liblz4-dev)
fi

if [[ ${DGSFM_SKIP_INSTALL:-0} == 1 ]] || ! command -v dpkg-query >/dev/null; then
  echo "Nothing is installed; needed are, by their names in Debian:" \
    "${packages[*]}" >&2
  exit 0
fi

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query --show --showformat '${db:Status-Status}' "$package" \
    2>/dev/null || true)
  if [[ $status != installed ]]; then
    missing+=("$package")
  fi
done
if [[ ${#missing[@]} -eq 0 ]]; then
  exit 0
fi

as_root=()
if [[ $(id -u) -ne 0 ]]; then
  if ! command -v sudo >/dev/null; then
    echo "ERROR: as root, run: apt-get install ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo)
fi
install=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive
  apt-get install --yes --no-install-recommends)

# Package lists may be absent, or name versions that exist no longer.
echo "Installing ${missing[*]}"
if ! "${install[@]}" --simulate "${missing[@]}" </dev/null >/dev/null 2>&1; then
  "${as_root[@]}" apt-get update
fi
if ! "${install[@]}" "${missing[@]}" </dev/null; then
  "${as_root[@]}" apt-get update
  "${install[@]}" "${missing[@]}" </dev/null
fi
