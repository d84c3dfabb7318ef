#!/usr/bin/env bash
# Downloads a Debian source package into a folder:
#
#   apt_source.sh PACKAGE=VERSION FOLDER
#
# Machines rarely list source packages. This derives a private list from the
# machine's own package sources and runs apt with private folders, so that it
# needs no root and leaves the system's configuration as it is.
set -euo pipefail

if [[ $# -ne 2 ]]; then
  echo "usage: apt_source.sh PACKAGE=VERSION FOLDER" >&2
  exit 2
fi
package=$1
folder=$2

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work"/{sources,lists/partial,cache/archives/partial,state}

# Rewrites the package sources of the machine as sources of source packages.
eval "$(apt-config shell \
  main_list Dir::Etc::sourcelist/f parts_folder Dir::Etc::sourceparts/d)"
shopt -s nullglob
for file in "${parts_folder:-}"/*.sources; do
  sed -E 's/^[Tt]ypes:.*/Types: deb-src/' "$file" \
    >"$work/sources/$(basename "$file")"
done
for file in "${main_list:-}" "${parts_folder:-}"/*.list; do
  if [[ -f "$file" ]]; then
    sed -nE 's/^[[:space:]]*deb(-src)?[[:space:]]+/deb-src /p' "$file"
  fi
done | awk '!seen[$0]++' >"$work/sources/one-line.list"

# Hooks that the machine runs after its own updates are not for ours.
cat >"$work/apt.conf" <<CONF
Dir::Etc::SourceList "/dev/null";
Dir::Etc::SourceParts "$work/sources";
Dir::State "$work/state";
Dir::State::Lists "$work/lists";
Dir::Cache "$work/cache";
Acquire::Languages "none";
APT::Sandbox::User "root";
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
CONF

# A package source that cannot be reached does not matter if another one has
# the package, so only the download decides.
mkdir -p "$folder"
cd "$folder"
if ! { apt-get -c "$work/apt.conf" update || true
       apt-get -c "$work/apt.conf" source --download-only --only-source \
         "$package"; } >"$work/log" 2>&1; then
  cat "$work/log" >&2
  echo "ERROR: Debian's source package $package is not available from the" \
    "package sources of this machine" >&2
  exit 1
fi
