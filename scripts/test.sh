#!/usr/bin/env bash
# Builds everything and runs the tests. Arguments go to CMake, as in
# "test.sh -DDGSFM_WARNINGS_AS_ERRORS=ON".
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Tests in Python skip where its packages cannot be had.
if python=$(scripts/python_env.sh); then
  set -- -DDGSFM_PYTHON="$python" "$@"
fi
scripts/build.sh all "$@"
ctest --preset release
