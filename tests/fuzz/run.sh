#!/usr/bin/env bash
# Builds the fuzzers with Clang and runs each for a time of the processor, of its
# child processes too:
#
#   run.sh [SECONDS [FORMAT...]]      600 seconds, all
#
# Corpora and findings are kept in build/fuzz/corpus. Allocations beyond 2.5 GB,
# more than the largest map takes as doubles, count as findings. What libhdf5 does
# wrong in the process that reads for us leaves files there too, but ends nothing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

seconds=${1:-600}
formats=("${@:2}")
if [[ ${#formats[@]} -eq 0 ]]; then
  formats=(NPY NPZ PFM PNG BIN EXR TIFF HDF5 BLOB DATABASE MATCHES SCORES)
fi
export CC=${CC:-clang-14} CXX=${CXX:-clang++-14}
# COLMAP is not what is tested: one build of it, by the usual compiler, will do.
colmap=$(CC=cc CXX=c++ scripts/build_colmap.sh | tail -n 1)
cmake --preset fuzz -DCMAKE_CXX_COMPILER="$CXX" -DCMAKE_C_COMPILER="$CC" \
  -DCOLMAP_DIR="$colmap/share/colmap" >/dev/null
cmake --build build/fuzz --target "${formats[@]/#/fuzz_}"
"$(scripts/python_env.sh)" tests/fuzz/seeds.py build/fuzz/corpus
# libhdf5 asks for more than there is, and knows what to do without.
export ASAN_OPTIONS=allocator_may_return_null=1
TIMEFORMAT="%3U %3S"
for format in "${formats[@]}"; do
  corpus=build/fuzz/corpus/$format
  echo "fuzz_$format, $seconds s"
  # Reading HDF5 has 60 s for each answer.
  timeout=30
  if [[ $format == HDF5 ]]; then timeout=300; fi
  left_ms=$((1000 * seconds))
  # Its own limit is of time on the clock.
  while ((left_ms > 0)); do
    used=$({ time "build/fuzz/tests/fuzz/fuzz_$format" \
      -max_total_time=$((left_ms / 1000 + 1)) \
      -malloc_limit_mb=2500 -rss_limit_mb=6000 -timeout=$timeout \
      -print_final_stats=1 \
      -artifact_prefix="$corpus-" "$corpus" 2>"$corpus.log"; } 2>&1) ||
      { tail -n 40 "$corpus.log"; exit 1; }
    read -r user system <<<"${used//./}"
    left_ms=$((left_ms - 10#$user - 10#$system))
  done
  grep -E "stat::(number_of_executed|peak)" "$corpus.log"
done
