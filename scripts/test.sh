#!/usr/bin/env bash
# Builds everything and runs the tests. Arguments go to CMake, as in
# "test.sh -DDGSFM_WARNINGS_AS_ERRORS=ON".
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/build.sh all "$@"
ctest --preset release
