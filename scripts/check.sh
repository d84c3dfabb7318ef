#!/usr/bin/env bash
# Slower checks than .ci/run has, each in a build folder of its own:
#
#   check.sh         all of these
#   check.sh lint    shellcheck of the scripts, hadolint of the Dockerfile
#   check.sh tidy    clang-tidy 14 with the checks of .clang-tidy
#   check.sh asan    the tests with AddressSanitizer and UBSan
#   check.sh readers the part of asan that covers files, databases and
#                    estimators
#   check.sh tsan    the tests with ThreadSanitizer
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

options=()
if command -v ccache >/dev/null; then
  options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
if python=$(scripts/python_env.sh); then
  options+=(-DDGSFM_PYTHON="$python")
fi

check_lint() {
  if ! command -v shellcheck >/dev/null; then
    echo "ERROR: shellcheck is not installed (package shellcheck)" >&2
    return 2
  fi
  shellcheck scripts/*.sh packaging/*.sh
  local lint_python
  lint_python=$(scripts/python_env.sh packaging/requirements.txt)
  "$(dirname "$lint_python")/hadolint" Dockerfile
}

check_tidy() {
  if ! command -v run-clang-tidy-14 >/dev/null; then
    echo "ERROR: run-clang-tidy-14 is not installed (package clang-tidy-14)" >&2
    return 2
  fi
  cmake --preset dev "${options[@]}"
  run-clang-tidy-14 -quiet -p build/dev \
    "$PWD/(colmap_ext|estimators|sfm|controllers)/.*\.cc$"
}

check_sanitizer() {
  cmake --preset "$1" "${options[@]}"
  cmake --build --preset "$1"
  ctest --preset "$1"
}

check_readers() {
  cmake --preset asan "${options[@]}"
  cmake --build --preset asan --target colmap_ext_test estimators_test
  # The other tests are listed, but not built.
  ctest --preset asan -L '^(colmap_ext|estimators)$'
}

scripts/install_dependencies.sh
if [[ $# -eq 0 ]]; then
  set -- lint tidy asan tsan
fi
for check in "$@"; do
  case $check in
    lint) check_lint ;;
    tidy) check_tidy ;;
    asan | tsan) check_sanitizer "$check" ;;
    readers) check_readers ;;
    *)
      sed -n '2,10s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2
      exit 2
      ;;
  esac
done
