#!/usr/bin/env bash
# Runs the benchmark: builds the program, gets the Python packages, and passes
# its arguments on. "benchmark.sh run NAME" runs benchmark/experiments/NAME.toml
# and refreshes docs/results.md; see benchmark/README.md.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if [[ ${1:-} == run && -z ${DGSFM_BENCHMARK_NO_BUILD:-} ]]; then
  scripts/build.sh colmap_main >&2
fi
python=$(scripts/python_env.sh)
PYTHONPATH=benchmark exec "$python" -B -m dgsfm_benchmark "$@"
