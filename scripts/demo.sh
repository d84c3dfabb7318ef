#!/usr/bin/env bash
# From nothing to a picture of a reconstruction: installs, builds, synthesizes
# a scene with exact truth, extracts and matches features with COLMAP, imports
# the depth maps, maps, evaluates and draws. The results are in build/demo.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/build.sh colmap_main

colmap=$PWD/build/release/bin/colmap
demo=$PWD/build/demo
scene=$demo/scene
logs=$demo/logs
rm -rf "$demo"
mkdir -p "$logs"

# Runs a command of the program, with its output in files.
run() {
  echo "colmap $*"
  if ! QT_QPA_PLATFORM=offscreen "$colmap" "$@" \
    >"$logs/$1.txt" 2>"$logs/$1.log" </dev/null; then
    tail -n 20 "$logs/$1.txt" "$logs/$1.log" >&2
    echo "ERROR: colmap $1 failed, its log is in $logs" >&2
    exit 1
  fi
}

run depth_scene_synthesizer --output_path "$scene"
run feature_extractor --database_path "$demo/database.db" \
  --image_path "$scene/images" --ImageReader.single_camera 1 \
  --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 1500
run exhaustive_matcher --database_path "$demo/database.db" \
  --SiftMatching.use_gpu 0
run depth_importer --database_path "$demo/database.db" \
  --depth_path "$scene/depth"
run depth_global_mapper --database_path "$demo/database.db" \
  --image_path "$scene/images" --output_path "$demo/model"
run model_evaluator --input_path "$demo/model/0" \
  --ground_truth_path "$scene/gt"
run model_renderer --input_path "$demo/model/0" \
  --output_path "$demo/model.png"

echo
cat "$logs/model_evaluator.txt"
echo "Model:   $demo/model/0"
echo "Picture: $demo/model.png"
echo "Report:  $demo/model/report.html"
