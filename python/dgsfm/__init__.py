"""Depth-guided global structure from motion on COLMAP databases.

    import dgsfm

    dgsfm.import_depth("my.db", {"a.jpg": depth_of_a, "b.jpg": depth_of_b})
    models = dgsfm.global_depth_mapping("my.db", "model", image_path="photos")
    print(models[0].path, models.report["warnings"])

Log lines go to the logger "dgsfm". Functions release Python's global lock, may
run at the same time on different databases, and end within about a second of
Ctrl-C, which leaves databases usable. They raise RuntimeError with the message
of the command of the same task, and ValueError for options out of bounds.
"""

from ._api import (
    DatabasePath,
    Model,
    Models,
    evaluate,
    export_depth,
    global_depth_mapping,
    import_dense_matches,
    import_depth,
    merge_shards,
    read_report,
    verify_pairs,
)
from ._version import __version__
from .options import (
    DenseMatchImporterOptions,
    DepthExporterOptions,
    DepthGeometricVerifierOptions,
    DepthGlobalMapperOptions,
    DepthImporterOptions,
)

__all__ = [
    "DatabasePath",
    "DenseMatchImporterOptions",
    "DepthExporterOptions",
    "DepthGeometricVerifierOptions",
    "DepthGlobalMapperOptions",
    "DepthImporterOptions",
    "Model",
    "Models",
    "__version__",
    "evaluate",
    "export_depth",
    "global_depth_mapping",
    "import_dense_matches",
    "import_depth",
    "merge_shards",
    "read_report",
    "verify_pairs",
]
