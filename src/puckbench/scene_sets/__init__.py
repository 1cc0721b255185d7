"""Data sets of scenes (meshes or point clouds), generated or on disk.

To add a data set, register a class in a file here or elsewhere (``path/to/file.py:Class``). A
folder of mesh files needs only::

    @LOADERS.register("mine")
    class Mine(MeshFolderSet):
        licence, credit, expected = "CC-BY 4.0", "me", "expected my meshes (.obj)"

        def _listed(self, folder: Path) -> Mapping[str, Path]:
            return {path.stem: path for path in sorted(folder.glob("*.obj"))}

        def _group(self, path: Path) -> str:
            return "object"
"""
