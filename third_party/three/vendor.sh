#!/usr/bin/env bash
# Makes three.min.js: what exports.mjs names of three.js, in one script that
# defines THREE. Packages are pinned by version and checksum, so that the result
# is the same byte by byte. Needs node and npm; the build of the project needs
# neither, since the result is kept beside this script.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

three=three@0.187.0
three_sha512=422bbb47e0a687c0acb59b18d6e24e4969d595fa3b66d34b57b985f0996d9372c1dc0b43bbd71166572744a90093c638cfa28ac37e73ed8ed4addee3598f1eb4
esbuild=@esbuild/linux-x64@0.28.2
esbuild_sha512=e314d9af5154992a105b85c85a68addedcd0ad44d933e3773f45d5f3144e298179d177c8ef178ef74fb56d9bcdc3122e7d0f610d0551247e588603d517c03f1d

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# fetch PACKAGE CHECKSUM FOLDER: unpacks a package of npm.
fetch() {
  local archive
  archive=$work/$(cd "$work" && npm pack --silent "$1")
  echo "$2  $archive" | sha512sum --check --quiet
  mkdir -p "$3"
  tar -xzf "$archive" -C "$3" --strip-components 1
}
fetch "$three" "$three_sha512" "$work/node_modules/three"
fetch "$esbuild" "$esbuild_sha512" "$work/esbuild"

cp exports.mjs "$work"
(cd "$work" && esbuild/bin/esbuild exports.mjs --bundle --minify \
  --format=iife --global-name=THREE --legal-comments=inline --target=es2020 \
  --log-level=warning --outfile=three.min.js)
cp "$work/node_modules/three/LICENSE" "$work/three.min.js" .
sha256sum three.min.js
