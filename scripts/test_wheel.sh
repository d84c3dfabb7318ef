#!/usr/bin/env bash
# Tests a wheel of dist/ in a minimal Debian 12, which has Python but neither
# compilers nor libraries of ours:
#
#   test_wheel.sh WHEEL [FOLDER_OF_ROOT]
#
# The wheel has to be of Debian's Python, 3.11. Needs root and debootstrap; makes
# the root where there is none (default: in the user's cache folder). Real photos
# of ../shared/data take part where they are.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

wheel=${1:?usage: test_wheel.sh WHEEL [FOLDER_OF_ROOT]}
root=${2:-${XDG_CACHE_HOME:-$HOME/.cache}/dgsfm/bookworm}

if [[ ! -d $root ]]; then
  mkdir -p "$(dirname "$root")"
  debootstrap --variant=minbase --include=python3,python3-venv bookworm \
    "$root.new" >/dev/null
  mv "$root.new" "$root"
fi

work=$root/dgsfm
rm -rf "$work"
mkdir -p "$work/main" "$work/wheels"
cp -r python "$work/main"
if [[ -d ../shared/data/fountain-P11 ]]; then
  mkdir -p "$work/shared/data"
  cp -r ../shared/data/fountain-P11 "$work/shared/data"
fi
cp "$wheel" "$work/wheels"
# The root has no network.
/usr/bin/python3 -m pip download --quiet --disable-pip-version-check \
  --only-binary :all: --dest "$work/wheels" numpy==1.26.4 pytest==8.3.5
cat >"$work/run.sh" <<'SCRIPT'
set -e
cd /dgsfm/main/python/tests
[ -e /proc/self ] || mount -t proc proc /proc
python3 -m venv /dgsfm/env
/dgsfm/env/bin/pip install --quiet --no-index --find-links /dgsfm/wheels \
  dgsfm pytest
if command -v cc || ldconfig -p | grep -E 'ceres|boost|glog'; then
  echo "ERROR: this root is not minimal" >&2
  exit 1
fi
/dgsfm/env/bin/dgsfm help | grep depth_global_mapper
/dgsfm/env/bin/python -B run.py test_import.py test_options.py test_mapping.py
SCRIPT
unshare --mount --pid --fork chroot "$root" sh /dgsfm/run.sh
