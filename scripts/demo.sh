#!/usr/bin/env bash
# From nothing to a picture of a reconstruction: installs, builds, synthesizes
# a scene with exact truth, extracts and matches features with COLMAP, imports
# the depth maps, maps, evaluates and draws. The results are in build/demo.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/build.sh colmap_main

colmap=$PWD/build/release/bin/colmap
demo=$PWD/build/demo
rm -rf "$demo"
mkdir -p "$demo"

# Runs a command of the program, with its log in a file.
run() {
  echo "colmap $*"
  if ! QT_QPA_PLATFORM=offscreen "$colmap" "$@" \
    >"$demo/$1.txt" 2>"$demo/$1.log"; then
    tail -n 20 "$demo/$1.txt" "$demo/$1.log" >&2
    echo "ERROR: colmap $1 failed, see $demo/$1.log" >&2
    exit 1
  fi
}

run depth_scene_synthesizer --output_path "$demo"
run feature_extractor --database_path "$demo/database.db" \
  --image_path "$demo/images" --ImageReader.single_camera 1 \
  --SiftExtraction.use_gpu 0
run exhaustive_matcher --database_path "$demo/database.db" \
  --SiftMatching.use_gpu 0
run depth_importer --database_path "$demo/database.db" \
  --depth_path "$demo/depth"
run depth_global_mapper --database_path "$demo/database.db" \
  --image_path "$demo/images" --output_path "$demo/model"
run model_evaluator --input_path "$demo/model/0" \
  --ground_truth_path "$demo/gt"
run model_renderer --input_path "$demo/model/0" \
  --output_path "$demo/model.png"

echo
cat "$demo/model_evaluator.txt"
echo "Model:   $demo/model/0"
echo "Picture: $demo/model.png"
