#!/usr/bin/env bash
# Builds self-contained wheels of the Python package in dist/:
#
#   build_wheel.sh [PYTHON...]
#
# One for each interpreter (default: python3), except that one of 3.12 serves all
# later versions too. All shared libraries that a minimal system lacks go
# inside, with their licences. Needs scripts/install_dependencies.sh's packages
# and, for what pip installs, a package index.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

pythons=("$@")
[[ ${#pythons[@]} -gt 0 ]] || pythons=(python3)
scripts/install_dependencies.sh

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tools=$work/tools
python3 -m venv "$tools"
"$tools/bin/pip" install --quiet --disable-pip-version-check \
  --requirement python/wheel_requirements.txt
export PATH=$tools/bin:$PATH
# The compiler of the other builds, not that which built the interpreter.
export CC=${CC:-/usr/bin/cc} CXX=${CXX:-/usr/bin/c++}
if command -v ccache >/dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=ccache
fi

# The copyright files of the Debian packages whose libraries a wheel holds.
add_licences() {
  local wheel=$1 folder=$work/unpacked package real
  rm -rf "$folder"
  python -m wheel unpack --dest "$folder" "$wheel" >/dev/null
  local content=("$folder"/*)
  mkdir -p "${content[0]}/dgsfm/licences"
  cp LICENSE "${content[0]}/dgsfm/licences/dgsfm"
  while read -r real; do
    package=$(dpkg-query --search "$real" 2>/dev/null ||
      dpkg-query --search "${real#/usr}")
    package=${package%%:*}
    cp "/usr/share/doc/$package/copyright" \
      "${content[0]}/dgsfm/licences/$package"
  done <"$work/libraries"
  rm "$wheel"
  python -m wheel pack --dest-dir "$(dirname "$wheel")" "${content[0]}" \
    >/dev/null
}

mkdir -p dist
for python in "${pythons[@]}"; do
  rm -rf "$work/raw" "$work/repaired"
  "$python" -m venv "$work/env"
  "$work/env/bin/pip" wheel --quiet --disable-pip-version-check --no-deps \
    --wheel-dir "$work/raw" ./python
  rm -rf "$work/env"
  auditwheel repair --wheel-dir "$work/repaired" "$work"/raw/*.whl \
    2>"$work/log" || { cat "$work/log" >&2; exit 1; }
  # What auditwheel has grafted: the libraries that the module needs and that
  # manylinux does not promise, by their paths here.
  unzip -q -o "$work"/raw/*.whl 'dgsfm/_core*.so' -d "$work/module"
  ldd "$work"/module/dgsfm/_core*.so | awk '/=> \//{print $3}' |
    sort -u >"$work/all_libraries"
  unzip -l "$work"/repaired/*.whl 'dgsfm.libs/*' |
    sed -n 's:.*dgsfm.libs/\([^.]*\)-[0-9a-f]\{8\}\.\(.*\):\1.\2:p' |
    sort -u >"$work/grafted"
  while read -r library; do
    real=$(readlink -f "$library")
    if grep -qxF "$(basename "$real")" "$work/grafted"; then echo "$real"; fi
  done <"$work/all_libraries" >"$work/libraries"
  if [[ $(wc -l <"$work/libraries") -ne $(wc -l <"$work/grafted") ]]; then
    echo "ERROR: not every library of the wheel was found for its licence" >&2
    exit 1
  fi
  rm -r "$work/module"
  add_licences "$work"/repaired/*.whl
  cp "$work"/repaired/*.whl dist/
  echo "dist/$(basename "$work"/repaired/*.whl)"
done
