#!/usr/bin/env bash
# Installs what is missing and builds a target of the release preset:
#
#   build.sh TARGET [CMAKE_OPTION...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

target=${1:?usage: build.sh TARGET [CMAKE_OPTION...]}
options=("${@:2}")
if command -v ccache >/dev/null; then
  options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi

scripts/install_dependencies.sh
cmake --preset release "${options[@]}"
cmake --build --preset release --target "$target"
