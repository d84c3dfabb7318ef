#!/usr/bin/env bash
# Lists the C++ sources that clang-format would change; exit code 1 if there
# are any. Another version formats differently, so only version 14 will do.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

formatter=$(command -v clang-format-14 || command -v clang-format || true)
if [[ -z $formatter ]]; then
  echo "ERROR: clang-format-14 is not installed" >&2
  exit 2
fi
if ! "$formatter" --version | grep -q 'version 14\.'; then
  echo "ERROR: $("$formatter" --version) is not version 14" >&2
  exit 2
fi

mapfile -t sources < <(git ls-files '*.h' '*.cc')
failed=0
for source in "${sources[@]}"; do
  if ! "$formatter" --dry-run --Werror "$source" 2>/dev/null; then
    echo "$source: not formatted"
    failed=1
  fi
done
echo "${#sources[@]} files checked for format"
exit "$failed"
