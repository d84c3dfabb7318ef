#!/usr/bin/env bash
# Installs the packages of scripts/build_packages.sh in minimal systems without
# build tools, and maps a scene there:
#
#   test_packages.sh [SUITE MIRROR]
#
# By default the Debian package and the tarball are tried in a minimal system of
# this machine's Debian. With a suite and its mirror (jammy, noble, ...) the
# tarball alone is tried in that. Needs root, debootstrap and 2 GB below
# ${TMPDIR:-/tmp}. Models have to be those of the program that was built, byte
# for byte.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

suite=${1:-}
mirror=${2:-}
is_debian=
if [[ -z $suite ]]; then
  is_debian=1
  # shellcheck source=/dev/null
  suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
  # shellcheck disable=SC2016
  mirror=$(apt-get indextargets --format '$(SITE)' \
    "Created-By: Packages" "Codename: $suite" | sort -u | head -n 1)
fi
if [[ $(id -u) -ne 0 ]] || ! command -v debootstrap >/dev/null; then
  echo "ERROR: needs root and debootstrap" >&2
  exit 2
fi
colmap=$PWD/build/release/bin/colmap
packages=$PWD/build/release/packages
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

scene=(depth_scene_synthesizer --output_path /tmp/scene --database_only 1
  --num_images 12)
mapping=(depth_global_mapper --database_path /tmp/scene/database.db
  --output_path /tmp/model --num_threads 1)

# Runs a command in a root; its /proc goes with the mount namespace.
in_root() {
  # shellcheck disable=SC2016
  unshare --mount sh -c 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"' \
    "$@"
}

# Runs the program with these words in a root, and compares the model.
map_in() {
  local root=$1
  shift
  rm -rf "$root/tmp/scene" "$root/tmp/model"
  in_root "$root" env -i "$@" help >/dev/null
  in_root "$root" env -i "$@" "${scene[@]}" >/dev/null
  in_root "$root" env -i "$@" "${mapping[@]}" >"$work/log" 2>&1 ||
    { tail "$work/log" >&2; exit 1; }
  for file in cameras images points3D; do
    cmp "$root/tmp/model/0/$file.bin" "$work/expected/0/$file.bin"
  done
}

mkdir "$work/reference"
"$colmap" "${scene[@]/#\/tmp\/scene/$work/reference/scene}" >/dev/null
"$colmap" depth_global_mapper --num_threads 1 \
  --database_path "$work/reference/scene/database.db" \
  --output_path "$work/expected" >/dev/null 2>&1

echo "Installing a minimal $suite"
debootstrap --variant=minbase "$suite" "$work/root" "$mirror" >"$work/log" 2>&1 ||
  { tail "$work/log" >&2; exit 1; }
if [[ -x $work/root/usr/bin/cc || -x $work/root/usr/bin/cmake ]]; then
  echo "ERROR: the minimal system has build tools" >&2
  exit 1
fi

# The newest version of a library's symbols that the files need.
newest() {
  local prefix=$1
  shift
  objdump --dynamic-syms "$@" 2>/dev/null |
    grep --only-matching --extended-regexp "\<${prefix}_[0-9.]+" | sort -Vu |
    tail -n 1
}

mkdir "$work/root/opt/anywhere"
tar --extract --file "$packages"/dgsfm-*.tar.gz --strip-components 1 \
  --directory "$work/root/opt/anywhere"
# Ubuntu 22.04 has these, and so have later systems (docs/packages.md).
for limit in GLIBC_2.35 GLIBCXX_3.4.30; do
  needed=$(newest "${limit%_*}" \
    "$work"/root/opt/anywhere/{bin/colmap,lib/*.so*})
  if [[ $(printf '%s\n' "$needed" "$limit" | sort -V | tail -n 1) != "$limit" ]]
  then
    echo "ERROR: the tarball needs $needed, and Ubuntu 22.04 has $limit" >&2
    exit 1
  fi
done
map_in "$work/root" /opt/anywhere/bin/colmap
# Moved, as it must not depend on where it was unpacked.
mv "$work/root/opt/anywhere" "$work/root/srv/elsewhere"
map_in "$work/root" /srv/elsewhere/bin/dgsfm
echo "The tarball maps in $suite"

if [[ -n $is_debian ]]; then
  cp "$packages"/dgsfm_*.deb "$work/root/tmp"
  cp /etc/resolv.conf "$work/root/etc/resolv.conf"
  in_root "$work/root" sh -c "apt-get update &&
    DEBIAN_FRONTEND=noninteractive apt-get install --yes \
      --no-install-recommends /tmp/dgsfm_*.deb" >"$work/log" 2>&1 ||
    { tail "$work/log" >&2; exit 1; }
  map_in "$work/root" PATH=/usr/bin:/bin dgsfm
  # Scripts that call colmap.
  map_in "$work/root" PATH=/usr/lib/dgsfm/bin:/usr/bin:/bin colmap
  in_root "$work/root" apt-get remove --yes dgsfm >"$work/log" 2>&1
  test ! -e "$work/root/usr/lib/dgsfm"
  echo "The Debian package installs, maps and goes in $suite"
fi
