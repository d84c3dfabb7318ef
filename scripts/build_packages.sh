#!/usr/bin/env bash
# Makes the Debian package and the tarball (docs/packages.md) in
# build/release/packages.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/install_dependencies.sh --packages
scripts/build.sh colmap_main
rm -rf build/release/packages
cd build/release
cpack
rm -rf packages/_CPack_Packages
ls packages/*
