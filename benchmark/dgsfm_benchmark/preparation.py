"""What is done once per scene: images, features, matches, depth import."""

from __future__ import annotations

import dataclasses
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

import pycolmap

from .database import (
    copy_with_images,
    drop_descriptors,
    merge_cameras,
    set_prior_focal_lengths,
)
from .depth_changes import CHANGES, change_depth
from .engines import NO_DEPTH, run_pycolmap
from .errors import BenchmarkError
from .files import file_digest, slug, value_digest
from .process import run_program
from .scene import Scene


@dataclasses.dataclass(frozen=True)
class Preparation:
    """Prepares the scenes of one data set, in a folder that is kept."""

    folder: Path
    program: Path  # of this project
    max_image_size: int  # [px]; 0 = any
    threads: int

    def prepare_collections(self, scenes: Iterable[Scene]) -> None:
        """Extracts and matches features of scenes that come without, once
        for all scenes that share images."""
        collections: dict[Path, list[Scene]] = {}
        for scene in scenes:
            if scene.database is None:
                collections.setdefault(scene.image_folder, []).append(scene)
        for image_folder, members in collections.items():
            database = self._collection_database(image_folder)
            if not database.exists():
                self._match_collection(database, image_folder, members)

    def image_folder(self, scene: Scene) -> Path:
        """Folder of the images, reduced where they are too large."""
        if scene.database is not None:
            if scene.image_folder.is_dir():
                return scene.image_folder
            # COLMAP's mappers insist on a folder of images, if an empty one.
            folder = self.folder / slug(scene.name) / "images"
            folder.mkdir(parents=True, exist_ok=True)
            return folder
        return self._collection_database(scene.image_folder).parent / "images"

    def database(
        self,
        scene: Scene,
        depth: str,
        depth_options: list[str],
        one_camera: bool = False,
        depth_change: str | None = None,
    ) -> Path:
        """Database of a scene with a kind of depth that it has, changed by
        one of CHANGES, and one camera entry for all images if that is
        wanted."""
        folder = self.folder / slug(scene.name)
        folder.mkdir(parents=True, exist_ok=True)
        base = scene.database or self._collection_database(scene.image_folder)
        # Synthetic scenes change with the program.
        cameras = "one_camera-" if one_camera else ""
        priors = scene.prior_focal_lengths
        if priors:
            cameras += value_digest(sorted(priors.items())) + "-"
        path = folder / f"{NO_DEPTH}-{cameras}{file_digest(base)}.db"
        if not path.exists():
            temporary = folder / "new.db"
            copy_with_images(base, temporary, scene.truth.keys())
            if one_camera:
                merge_cameras(temporary)
            if priors:
                set_prior_focal_lengths(temporary, priors)
            os.replace(temporary, path)
        if depth not in scene.depth_folders:
            return path
        return self._with_depth(
            path, scene.depth_folders[depth], depth, depth_options, depth_change
        )

    def _with_depth(self, base, depth_folder, depth, depth_options, change):
        # Another program may store depth otherwise.
        key = value_digest(
            [file_digest(self.program), depth_options, base.name]
            + ([change] if change else [])
        )
        path = base.with_name(f"{depth}-{key}.db")
        if path.exists():
            return path
        temporary = base.with_name("new.db")
        temporary.write_bytes(base.read_bytes())
        with tempfile.TemporaryDirectory(dir=base.parent) as changed:
            if change:
                change_depth(depth_folder, Path(changed), change)
                depth_folder = Path(changed)
                # Another kind of depth has no use for the options of this.
                depth_options = (
                    CHANGES[change].importer_options or depth_options
                )
            run_program(
                [
                    str(self.program), "depth_importer",
                    "--database_path", str(temporary),
                    "--depth_path", str(depth_folder),
                    *depth_options,
                ],
                base.with_name("log.txt"),
            )  # fmt: skip
        os.replace(temporary, path)
        return path

    def _collection_database(self, image_folder: Path) -> Path:
        key = value_digest([str(image_folder), self.max_image_size])
        return self.folder / f"collection-{key}" / "database.db"

    def _match_collection(self, database, image_folder, scenes):
        folder = database.parent
        folder.mkdir(parents=True, exist_ok=True)
        names = sorted({name for scene in scenes for name in scene.truth})
        for name in names:
            self._place_image(image_folder / name, folder / "images" / name)
        temporary = folder / "new.db"
        temporary.unlink(missing_ok=True)
        job = {
            "database": str(temporary),
            "images": str(folder / "images"),
            "names": names,
            "threads": self.threads,
            "seed": 0,
            "pairs": str(scenes[0].pairs) if scenes[0].pairs else None,
        }
        for stage in ("features", "matching"):
            run_pycolmap(stage, folder / "log.txt", **job)
        drop_descriptors(temporary)
        os.replace(temporary, database)

    def _place_image(self, source: Path, target: Path) -> None:
        if target.exists():
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        bitmap = pycolmap.Bitmap.read(str(source), as_rgb=True)
        if bitmap is None:
            raise BenchmarkError(f"image '{source}' cannot be read")
        size = max(bitmap.width, bitmap.height)
        if self.max_image_size <= 0 or size <= self.max_image_size:
            target.symlink_to(source.resolve())
            return
        ratio = self.max_image_size / size
        bitmap.rescale(
            round(bitmap.width * ratio), round(bitmap.height * ratio)
        )
        temporary = target.with_name("new-" + target.name)
        bitmap.write(str(temporary))
        os.replace(temporary, target)
