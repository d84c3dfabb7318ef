"""Benchmark of depth-guided SfM: data sets, engines, metrics and pages."""
